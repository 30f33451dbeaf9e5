"""Gait descriptors that belong together, in what is believed of them before any answer.

Shapes: D descriptors.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .table import DESCRIPTOR_NAMES

UNSTEADY = ("vertical_speed_sq", "roll_rate_sq", "pitch_rate_sq", "slip")
"""Habits hardly anybody wants more of, and that standing and a good walk both lack."""
TOLD = (
    "planar_error",
    "planar_error_sq",
    "yaw_rate_error",
    "yaw_rate_error_sq",
)
"""Not doing what the robot is told."""
EFFORT = ("joint_speed_sq", "torque_sq", "power", "action_rate_sq")
"""What any motion costs, and hardly anybody wants more of for its own sake."""
FEET = (
    "contacts",
    "foot_height_mean",
    "foot_height_max",
    "foot_speed_mean",
    "air_time_mean",
    "air_time_max",
    "lift_offs",
)
"""How the feet go. A robot that tumbles lifts them too, so answers about robots that
cannot walk yet say less of these than of anything else."""


def named(names: tuple[str, ...]) -> Tensor:
    """[D] bool: which habits have one of `names`."""
    return torch.tensor([name in names for name in DESCRIPTOR_NAMES])
