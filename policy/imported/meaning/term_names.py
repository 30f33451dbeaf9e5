"""What others call the terms of an observation."""

from __future__ import annotations

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
    plain = name.rpartition(":")[2].rpartition(".")[2].lower()
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
