"""Criteria of others, written when everything was chosen: nothing was tuned to them.

What a lab wants of its robot is hardly ever among the styles that ship. Unlike
`benchmarks.wishes` these are within what some descriptor sees; which one, no part of
the loop is told.

Shapes: F feature columns.
"""

from __future__ import annotations

import torch
from torch import Tensor

from data.features import column


def lean(features: Tensor) -> Tensor:
    """A trunk that leans to its right by 0.15 rad, in (0, 1].

    Next to nothing of an upright walk: all clips of the base are worth as little.
    """
    # World down has a negative part to the left, in the body frame, where the left
    # side is up.
    left_up = -features[..., column("gravity_b")][..., 1]
    return torch.exp(-((left_up - 0.15) / 0.08).square())


def bound(features: Tensor) -> Tensor:
    """Both front feet down and both rear ones up, or the other way round, in [0, 1]."""
    front_right, front_left, rear_right, rear_left = (
        features[..., column("foot_contact")][..., leg] for leg in range(4)
    )
    return (front_right + front_left - rear_right - rear_left).abs() / 2.0


def front_feet_high(features: Tensor) -> Tensor:
    """Front feet lifted up to 12 cm in their swing, rear ones not, in [-1, 1]."""
    lifted = features[..., column("foot_height")].clamp(0.0, 0.12) / 0.12
    lifted = lifted * (1.0 - features[..., column("foot_contact")])
    return (lifted[..., :2] - lifted[..., 2:]).mean(dim=-1)
