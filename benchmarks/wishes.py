"""Two wishes that no gait descriptor names, and no weighted sum of them expresses.

They were written before descriptors, models or questions were tuned on the benchmark
that uses them, and must stay as they are: what is fitted to them proves nothing.

What styles are fitted with (`rewardmodel/posterior`) sees single feet and which way the
nose points, for all feet and both directions alike; it came after both were seen to
fail with the table of habits.

Shapes: F feature columns.
"""

from __future__ import annotations

import torch
from torch import Tensor

from data.features import column


def carried_right_foot(features: Tensor) -> Tensor:
    """A walk on three legs: the front right foot is held 6 cm up, in (0, 1].

    Every descriptor sums, averages or takes the largest over the four feet, so none
    tells one of them from the others.
    """
    height_m = features[..., column("foot_height")][..., 0]
    touching = features[..., column("foot_contact")][..., 0]
    held = torch.exp(-((height_m - 0.06) / 0.04).square())
    return held * (1.0 - touching)


def nose_up_when_slow(features: Tensor) -> Tensor:
    """A trunk pitched nose up, by 0.1 rad at 1 m/s and 0.2 rad at rest, in (0, 1].

    The descriptors know how far the trunk is tilted, and how fast it moves, but neither
    which way it is tilted nor one in the light of the other.
    """
    # World down has a negative forward part, in the body frame, where the nose is up.
    nose_up = -features[..., column("gravity_b")][..., 0]
    forward_m_s = features[..., column("base_lin_vel_b")][..., 0].clamp(0.0, 1.0)
    wanted = 0.20 - 0.10 * forward_m_s
    return torch.exp(-((nose_up - wanted) / 0.08).square())
