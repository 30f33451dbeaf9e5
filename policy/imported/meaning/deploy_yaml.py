"""`params/deploy.yaml`, as unitree_rl_lab and its relatives write it.

`joint_ids_map` says which motor of the SDK (FR FL RR RL, hip thigh calf) each joint of
the policy is; stiffness and damping are in the order of the motors, all else in the
order of the policy. Histories are Isaac Lab's: term by term, oldest first.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data.features import JOINTS
from policy.law.law import LawError

from .draft import Draft, order_of, twelve
from .plain_yaml import at, read_plain_yaml
from .term_names import term_of

PHYSICS_DT_S = 0.005


def read_deploy(path: Path) -> Draft:
    """The law in a deploy.yaml.

    Raises:
        LawError: it is none.
    """
    told = read_plain_yaml(path)
    motors = order_of(told.get("joint_ids_map"), f"{path}: joint_ids_map")
    order = np.array(motors, dtype=int)
    action = at(told, "actions", "JointPositionAction")
    if not isinstance(action, dict):
        raise LawError(f"{path}: it has no actions.JointPositionAction")
    observations = told.get("observations")
    if not isinstance(observations, dict):
        raise LawError(f"{path}: it has no observations")
    terms = tuple(
        term_of(
            name,
            scale=at(value, "scale"),
            clip=at(value, "clip"),
            frames=at(value, "history_length"),
        )
        for name, value in observations.items()
    )
    default = twelve(told.get("default_joint_pos"), "default_joint_pos")
    offset = action.get("offset")
    step = told.get("step_dt")
    if not isinstance(step, float) or not 0.001 <= step <= 0.2:
        raise LawError(f"{path}: step_dt must be seconds, got {step!r}")
    substeps = max(1, round(step / PHYSICS_DT_S))
    return Draft(
        source=path.name,
        joints=tuple(JOINTS[motor] for motor in motors),
        terms=terms,
        newest_first=False,
        by_term=True,
        default_joint_pos_rad=default,
        action_scale_rad=twelve(action.get("scale"), "scale"),
        action_offset_rad=default if offset is None else twelve(offset, "offset"),
        kp_nm_per_rad=tuple(
            np.array(twelve(told.get("stiffness"), "stiffness"))[order]
        ),
        kd_nm_s_per_rad=tuple(np.array(twelve(told.get("damping"), "damping"))[order]),
        target_clip_rad=_clip(action.get("clip")),
        physics_dt_s=step / substeps,
        substeps=substeps,
        guessed={
            "physics_dt_s": "near 5 ms: the file says the time of an action alone",
            "torque_limit_nm": "those of the robot's model: the file says none",
        },
    )


def _clip(clip: object) -> tuple[tuple[float, float], ...] | None:
    """Isaac Lab's clip of an action is one of its target, in rad."""
    if not isinstance(clip, list) or len(clip) != 12:
        return None
    try:
        return tuple((float(low), float(high)) for low, high in clip)
    except (TypeError, ValueError):
        raise LawError("the clip of the action must be 12 pairs of numbers") from None
