"""The robot's safety as reward: terms every learned reward is added to.

Shapes: F feature columns.
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from data.features import column


@dataclass(frozen=True, kw_only=True)
class KnownTermsCfg:
    """Terms every learned reward is added to: the robot's safety, in plain sight."""

    alive: float = 1.0
    """Per second without a fall."""
    fall: float = -1.0
    """Once, when the robot falls."""
    torque: float = -2e-5
    """Per second, sum of squared joint torques, N^2 m^2."""
    joint_limits: float = -2.0
    """Per second, summed distance beyond 95 % of a joint's range, rad."""


def known_terms(
    features: Tensor,
    cfg: KnownTermsCfg,
    *,
    joint_offset_range: Tensor,
    control_dt_s: float,
) -> dict[str, Tensor]:
    """Weighted known terms of `features [..., F]` by name, each [...], per step.

    Args:
        features: Feature rows.
        cfg: The weights.
        joint_offset_range: Ranges [12, 2] of the joints, rad from the home pose.
        control_dt_s: Control step.
    """
    fallen = features[..., column("fallen")][..., 0]
    offset = features[..., column("joint_pos_offset")]
    low, high = joint_offset_range.unbind(-1)
    margin = 0.025 * (high - low)
    beyond = (low + margin - offset).clamp(min=0) + (offset - high + margin).clamp(
        min=0
    )
    return {
        "alive": cfg.alive * control_dt_s * (1.0 - fallen),
        "fall": cfg.fall * fallen,
        "torque": cfg.torque
        * control_dt_s
        * features[..., column("joint_torque")].square().sum(dim=-1),
        "joint_limits": cfg.joint_limits * control_dt_s * beyond.sum(dim=-1),
    }
