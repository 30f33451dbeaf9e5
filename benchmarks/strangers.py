"""Criteria of others, written when everything was chosen: nothing was tuned to them.

What a lab wants of its robot is hardly ever among the styles that ship. Unlike
`benchmarks.wishes` these are within what some descriptor sees; which one, no part of
the loop is told.

The two walks are learned from scratch. One is published, the other pays for the short
steps that the loop expects to be disliked.

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


def published_walk(features: Tensor) -> Tensor:
    """A walk as legged_gym, the code of Rudin et al. 2021, pays it by default.

    As far as rows tell: without joint accelerations and collisions, with air time paid
    while it lasts. Height, pose, slip, tilt and how high feet are lifted are all one.
    """
    error = features[..., column("command")][..., :2] - _velocity(features)[..., :2]
    rates = features[..., column("base_ang_vel_b")]
    yaw_error = features[..., column("command")][..., 2] - rates[..., 2]
    air_s = features[..., column("foot_air_time")]
    # A swing of `a` seconds earns a - 0.5, in units of a control step of 20 ms.
    swing = 0.02 * (air_s > 0).float() - 0.5 * ((air_s > 0) & (air_s < 0.03)).float()
    return (
        torch.exp(-_squares(error) / 0.25)
        + 0.5 * torch.exp(-yaw_error.square() / 0.25)
        - 2.0 * _velocity(features)[..., 2].square()
        - 0.05 * _squares(rates[..., :2])
        - 1e-5 * _squares(features[..., column("joint_torque")])
        - 0.01 * _squares(features[..., column("action_rate")])
        + swing.sum(dim=-1)
    )


def brisk_walk(features: Tensor) -> Tensor:
    """Quick low steps at the speed asked for: nearly the opposite of what `walk` hides.

    Every second costs 5 for each second beyond 0.12 s that a foot is in the air, and 4
    for each 10 cm above 4 cm.
    """
    error = features[..., column("command")][..., :2] - _velocity(features)[..., :2]
    rates = features[..., column("base_ang_vel_b")]
    yaw_error = features[..., column("command")][..., 2] - rates[..., 2]
    late = (features[..., column("foot_air_time")] - 0.12).clamp(0.0, 0.5)
    high = (features[..., column("foot_height")] - 0.04).clamp(0.0, 0.2)
    return (
        1.5 * torch.exp(-_squares(error) / 0.1)
        - 0.5 * yaw_error.abs()
        - 0.1 * _squares(rates[..., :2])
        - 5.0 * late.sum(dim=-1)
        - 40.0 * high.sum(dim=-1)
        - 2.0 * features[..., column("fallen")][..., 0]
    )


def _velocity(features: Tensor) -> Tensor:
    return features[..., column("base_lin_vel_b")]


def _squares(values: Tensor) -> Tensor:
    return values.square().sum(dim=-1)
