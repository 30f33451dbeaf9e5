"""`params/deploy.yaml`, as unitree_rl_lab and its relatives write it.

`joint_ids_map` says which motor of the SDK (FR FL RR RL, hip thigh calf) each joint of
the policy is; stiffness and damping are in the order of the motors, all else in the
order of the policy. Histories are Isaac Lab's: term by term, oldest first. Beside the
terms stand two switches: `use_gym_history` puts frames together, `scale_first` clips
what was scaled.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from data.features import JOINTS
from policy.law.law import LawError, Term

from .draft import Draft, order_of, twelve
from .plain_yaml import at, read_plain_yaml
from .term_names import term_of

PHYSICS_DT_S = 0.005
_SWITCHES = ("use_gym_history", "scale_first")


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
    by_frame, scale_first = (_is_on(path, observations, name) for name in _SWITCHES)
    terms = tuple(
        _term(name, value, scale_first=scale_first)
        for name, value in observations.items()
        if name not in _SWITCHES
    )
    default = twelve(told.get("default_joint_pos"), "default_joint_pos")
    offset = action.get("offset")
    step = told.get("step_dt")
    if not isinstance(step, float) or not 0.001 <= step <= 0.2:
        raise LawError(f"{path}: step_dt must be seconds, got {step!r}")
    substeps = max(1, round(step / PHYSICS_DT_S))
    guessed = {
        "physics_dt_s": "near 5 ms: the file says the time of an action alone",
        "torque_limit_nm": "those of the robot's model: the file says none",
    }
    if "joint_pos" in observations:
        guessed["joint_pos"] = (
            "angles from the default pose, as most trainers call them; Unitree's own "
            "controller takes them as absolute by this name"
        )
    return Draft(
        source=path.name,
        joints=tuple(JOINTS[motor] for motor in motors),
        terms=terms,
        newest_first=False,
        by_term=not by_frame,
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
        guessed=guessed,
    )


def _is_on(path: Path, observations: dict[str, Any], name: str) -> bool:
    on = observations.get(name) or False
    if not isinstance(on, bool):
        raise LawError(f"{path}: {name} must be true or false, got {str(on)[:40]}")
    return on


def _term(name: str, value: object, *, scale_first: bool) -> Term:
    term = term_of(
        name,
        scale=at(value, "scale"),
        clip=at(value, "clip"),
        frames=at(value, "history_length"),
    )
    if term.clip is None or not scale_first:
        return term
    # Ours clips before it scales, which is the same within bounds divided by the scale.
    scale = min(term.scale)
    if len(term.scale) > 1 or scale <= 0:
        raise LawError(
            f"with scale_first a clip of {name[:60]} needs one positive scale, got "
            f"{list(term.scale)}: say the term in a TOML (--law)"
        )
    low, high = (bound / scale for bound in term.clip)
    return replace(term, clip=(low, high))


def _clip(clip: object) -> tuple[tuple[float, float], ...] | None:
    """Isaac Lab's clip of an action is one of its target, in rad."""
    if not isinstance(clip, list) or len(clip) != 12:
        return None
    try:
        return tuple((float(low), float(high)) for low, high in clip)
    except (TypeError, ValueError):
        raise LawError("the clip of the action must be 12 pairs of numbers") from None
