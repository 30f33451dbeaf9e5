"""What an answer can be said to be about: aspects of a gait, and the habits of each.

Shapes: B answers.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from data.answers.answer_records import ASPECTS, Aspect

_BEGINNINGS: dict[Aspect, tuple[str, ...]] = {
    "posture": ("height", "joint_offset", "left_down", "nose_down", "tilt"),
    "feet": ("clearance", "foot_", "slip"),
    "rhythm": (
        "air_time",
        "contact",
        "diagonal_support",
        "end_support",
        "lift_offs",
        "side_support",
        "stride_rate",
    ),
    "steadiness": ("pitch_rate", "roll_rate", "vertical_speed"),
    "effort": ("action", "joint_speed", "power", "torque"),
}
"""How the names of their habits begin; what robots are told is no aspect."""
UNSAID = -1
"""In place of an index, where nobody said."""


def aspect_of(habit: str) -> Aspect | None:
    """The aspect of a habit; None of those about what the robot is told."""
    return next((a for a in ASPECTS if habit.startswith(_BEGINNINGS[a])), None)


def indices_of(whys: Sequence[str]) -> Tensor:
    """[B] indices in `ASPECTS`, `UNSAID` of an empty text."""
    return torch.tensor([ASPECTS.index(why) if why else UNSAID for why in whys])
