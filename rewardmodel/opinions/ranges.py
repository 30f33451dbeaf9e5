"""The range of each habit in what was recorded, and where on it a step lies.

Shapes: T steps, D descriptors, G habits (D and the stride rate).
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from rewardmodel.descriptors.row import Habit
from rewardmodel.descriptors.stride_rate import STRIDE_RATE, stride_rate
from rewardmodel.descriptors.table import columns_seen

TABLE: tuple[Habit, ...] = (*columns_seen("legs"), STRIDE_RATE)
"""What can matter to somebody: the descriptors, and the strides a second."""
HABITS = tuple(habit.name for habit in TABLE)
_RATES = (0.5, 1.75)
"""Range of the stride rate, in its median: a foot that chatters on the ground has many
times the rate of a walk, and on a range up to there all walks are alike."""
_RANGE_QUANTILE = 0.01
"""Steps left out at either end of the range of a habit."""
_PLENTY = 8000
"""Steps from which on every second, third, ... is looked at."""
_ROOT_FROM = 0.01
"""Added to a share of the range before its root is taken."""
_QUADRATIC = torch.tensor([habit.quadratic for habit in TABLE])


class Ranges(nn.Module):
    """From 0 to 1 lies what was recorded; below 0 and above 1 is beyond it."""

    def __init__(self) -> None:
        super().__init__()
        self.rate_mean: Tensor
        self.rate_std: Tensor
        self.ends: Tensor
        """[2, G] standardised"""
        self.register_buffer("rate_mean", torch.zeros(()))
        self.register_buffer("rate_std", torch.ones(()))
        self.register_buffer("ends", torch.zeros(2, len(HABITS)))

    def look_at(self, steps: Tensor, scored: Tensor, before: Tensor | None) -> Ranges:
        """Take the ranges from the steps `scored` [..., T] of standardised clips
        [..., T, D], with lift-offs `before` as in `stride_rate`."""
        rate = stride_rate(steps, scored=scored, before=before)[scored]
        std, mean = torch.std_mean(rate, correction=0)
        self.rate_mean.copy_(mean)
        self.rate_std.copy_(std if std > 1e-6 else torch.ones(()))
        low, high = (share * rate.median() for share in _RATES)
        rate = (rate.clamp(low, high) - self.rate_mean) / self.rate_std
        every = max(1, len(rate) // _PLENTY)
        seen = torch.cat([steps[scored], rate[:, None]], dim=-1)[::every]
        seen = seen.sort(dim=0).values
        last = len(seen) - 1
        ends = [round(share * last) for share in (_RANGE_QUANTILE, 1 - _RANGE_QUANTILE)]
        self.ends.copy_(seen[ends])
        return self

    def places(
        self,
        steps: Tensor,
        starts: Tensor | None = None,
        *,
        scored: Tensor | None = None,
        before: Tensor | None = None,
    ) -> Tensor:
        """[..., T, G] where on its range each habit of standardised sequences
        [..., T, D] is. Of squares it is the root, as nearly all of a gait would lie at
        the low end."""
        rate = stride_rate(steps, starts, scored=scored, before=before)
        rate = (rate - self.rate_mean) / self.rate_std
        return self.on_range(torch.cat([steps, rate[..., None]], dim=-1))

    def on_range(self, standardised: Tensor) -> Tensor:
        """[..., G] the same of standardised habits."""
        low, high = self.ends
        return laid_out((standardised - low) / (high - low).clamp_min(1e-6))

    @property
    def average(self) -> Tensor:
        """[G] where a step is that is average in everything."""
        return self.on_range(torch.zeros_like(self.ends[0]))


def laid_out(shares: Tensor) -> Tensor:
    """Places [..., G] of linear shares [..., G] of the ranges."""
    roots = _root(shares.clamp_min(0))
    return torch.where(_QUADRATIC.to(shares.device), roots, shares)


def _root(shares: Tensor) -> Tensor:
    """Square root of shares from 0 on, no steeper at 0 than a gradient bears; 1 stays
    1."""
    low, high = _ROOT_FROM**0.5, (1 + _ROOT_FROM) ** 0.5
    return ((shares + _ROOT_FROM).sqrt() - low) / (high - low)
