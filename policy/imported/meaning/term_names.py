"""What others call the terms of an observation."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from policy.law.law import WIDTHS, LawError, Term

_NAMES: dict[str, tuple[str, ...]] = {
    "base_lin_vel": ("lin_vel", "base_linear_velocity", "base_lin_vel_b"),
    "base_ang_vel": (
        "ang_vel",
        "base_angular_velocity",
        "imu_ang_vel",
        "gyro",
        "base_ang_vel_b",
    ),
    "projected_gravity": (
        "gravity_vec",
        "gravity",
        "gravity_b",
        "imu_projected_gravity",
    ),
    "command": (
        "commands",
        "velocity_commands",
        "velocity_command",
        "base_velocity",
        "generated_commands",
        "twist",
    ),
    "joint_pos": ("joint_pos_rel", "dof_pos", "joint_pos_offset"),
    "joint_vel": ("joint_vel_rel", "dof_vel"),
    "last_action": ("actions", "action", "prev_actions", "previous_actions"),
}
_ANGLES = {
    "joint_pos": "joint_pos_abs",
    "joint_pos_limit_normalized": "joint_pos_limit_normalized",
}
"""What functions give that are not angles from the default pose."""
_REFUSED = {
    "height": "a scan of heights",
    "scan": "a scan of heights",
    "camera": "a camera",
    "depth": "a camera",
    "image": "a camera",
    "rgb": "a camera",
    "lidar": "a lidar",
}


def term_name(name: str) -> str:
    """The name of `WIDTHS` for what others call `name`.

    Raises:
        LawError: it is none of them; what looks at the ground is named so.
    """
    plain = end_of(name).lower()
    if plain in WIDTHS:
        return plain
    for ours, spellings in _NAMES.items():
        if plain in spellings:
            return ours
    for word, told in _REFUSED.items():
        if word in plain:
            raise LawError(
                f"the policy sees {told} ({name[:60]!r}), and only proprioception is "
                "taken: give one trained on flat ground without it"
            )
    raise LawError(
        f"the policy sees {name[:60]!r}, which is not known here; the terms are "
        f"{', '.join(WIDTHS)}"
    )


def known_by(function: Any, name: str | None = None) -> str:
    """What to know a term by: the function that gives it where that says more surely
    what it is than the `name` somebody gave the term, as for absolute angles."""
    end = end_of(function)
    if end in _ANGLES:
        return _ANGLES[end]
    surely = end.endswith(("_rel", "_vel", "_gravity", "_scan"))
    return end if surely or name is None else name


def end_of(path: Any) -> str:
    """The name at the end of a path of Python."""
    return re.split(r"[:.]", str(path))[-1]


def term_of(
    name: str, *, scale: Any = None, clip: Any = None, frames: Any = None
) -> Term:
    """A term as files of others say it; None and 0 frames are the default.

    Raises:
        LawError: a value is of the wrong kind.
    """
    ours = term_name(name)
    try:
        values = (1.0,) if scale is None else _numbers(scale)
        if len(set(values)) == 1:
            values = values[:1]
        bounds = None if clip is None else _numbers(clip)
        if bounds is not None and len(bounds) != 2:
            raise ValueError
        return Term(
            name=ours,
            scale=values,
            clip=None if bounds is None else (bounds[0], bounds[1]),
            frames=max(1, int(frames or 1)),
        )
    except (TypeError, ValueError):
        raise LawError(
            f"scale, clip and history of {name[:60]!r} must be numbers, got "
            f"{str(scale)[:60]}, {str(clip)[:60]} and {str(frames)[:20]}"
        ) from None


def _numbers(value: Any) -> tuple[float, ...]:
    if isinstance(value, bool | str):
        raise TypeError
    if isinstance(value, Sequence):
        return tuple(float(v) for v in value)
    return (float(value),)
