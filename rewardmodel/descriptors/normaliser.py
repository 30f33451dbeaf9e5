"""Descriptors to numbers of order one, by constants frozen at the fit.

Shapes: K values, D descriptors.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

_CLAMP = 5.0
"""Standard deviations beyond which a descriptor says no more: one hard landing must not
outweigh a whole clip, and PPO must not be paid for leaving what was judged."""


class Normaliser(nn.Module):
    """Subtracts a mean, divides by a standard deviation and clamps."""

    def __init__(self, num_descriptors: int, *, most: float = _CLAMP) -> None:
        """Change nothing but what is beyond `most` deviations, until it is fitted."""
        super().__init__()
        self._most = most
        self.mean: Tensor
        self.std: Tensor
        self.register_buffer("mean", torch.zeros(num_descriptors))
        self.register_buffer("std", torch.ones(num_descriptors))

    def fit(self, descriptors: Tensor, counted: Tensor | None = None) -> Normaliser:
        """Take the constants from steps [..., D], those in `counted` [...] (bool); a
        constant descriptor is left at 0.

        What is missing, NaN, does not count; missing in all steps is constant.
        """
        # One after the other: in double precision, all would be many times the steps.
        columns = [
            _std_mean(column if counted is None else column[counted])
            for column in descriptors.unbind(dim=-1)
        ]
        std, mean = torch.tensor(columns, dtype=torch.float64).mT
        # Relative, because a constant column has the rounding error of its own size.
        constant = std <= 1e-6 * mean.abs().clamp_min(1e-3)
        self.mean.copy_(mean)
        self.std.copy_(torch.where(constant, torch.inf, std))
        return self

    def forward(self, descriptors: Tensor) -> Tensor:
        """Standardised descriptors [..., D]."""
        return (descriptors - self.mean).div_(self.std).clamp_(-self._most, self._most)


def _std_mean(values: Tensor) -> tuple[float, float]:
    """Deviation and mean of what is not missing in `values` [K]; 0 of nothing."""
    known = values[~values.isnan()] if values.isnan().any() else values
    if not len(known):
        return 0.0, 0.0
    std, mean = torch.std_mean(known.double(), correction=0)
    return float(std), float(mean)


def fill_missing(standardised: Tensor) -> Tensor:
    """Descriptors [..., D] with those that are missing, NaN, at their mean, 0.

    For clips only, where `ClipBatch` made sure that NaN means a feature nobody
    measured. In training a NaN is a fault, and has to go on to whoever notices.
    """
    missing = standardised.isnan()
    return standardised.masked_fill(missing, 0.0) if missing.any() else standardised
