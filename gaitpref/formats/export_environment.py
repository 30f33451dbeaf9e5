"""Which environment the episodes of a data set come from, as Gymnasium says it."""

from __future__ import annotations

import math
from dataclasses import replace

from .export_source import Source


def action_bound(largest: float) -> float:
    """The most an action may be, `largest` being that of the recordings.

    Infinite where nobody here can tell. Recordings made before actions were clipped
    to the limit may lie beyond it.
    """
    try:
        from policy.env.env_cfg import EnvCfg
    except ModuleNotFoundError:
        return math.inf
    return max(EnvCfg().action_limit, largest)


def env_spec(source: Source) -> str | None:
    """The environment that made all of `source`, for `gymnasium.make`, as JSON.

    None where there is none by name: another robot than the one that ships, other
    ground, another task or rate, or no simulator to look the robot up with.
    """
    try:
        import gymnasium
        from gymnasium.envs.registration import WrapperSpec
        from gymnasium.wrappers import RescaleAction

        from gaitpref.adapters.gym_registration import ENV_ID
        from policy.env.env_cfg import EnvCfg
        from policy.robots.robot import load_robot
    except ModuleNotFoundError:
        return None
    cfg = EnvCfg()
    dt_s = cfg.control_dt_s
    shipped = load_robot(physics_dt_s=cfg.physics_dt_s).model_sha256
    made_by_it = all(
        (meta.task, meta.model_sha256, meta.control_dt_s) == ("walk", shipped, dt_s)
        and "terrain" not in meta.extra
        for meta in (entry.meta for entry in source.entries)
    )
    if not made_by_it:
        return None
    # The environment takes actions in [-1, 1], the recordings are in the policy's unit.
    bounds = {"min_action": -cfg.action_limit, "max_action": cfg.action_limit}
    entry_point = f"{RescaleAction.__module__}:{RescaleAction.__name__}"
    rescale = WrapperSpec("RescaleAction", entry_point, bounds)
    spec = replace(
        gymnasium.spec(ENV_ID),
        kwargs={"reward": "task"},
        additional_wrappers=(rescale,),
    )
    return spec.to_json()
