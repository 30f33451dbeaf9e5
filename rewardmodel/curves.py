"""What a reward that is a sum over descriptors makes of each of them.

Shapes: M ensemble members, K values, D descriptors, G curves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from .descriptors import units_seen
from .linear import LinearScorer
from .model import RewardModel
from .sparse import SparseScorer

_POINTS = 41
_USUAL = 2.0
"""Deviations to either side that a straight line is told for."""
_SIGNED = ("forward_speed",)
"""Habits that can be negative; the others end at 0."""
_LEAST = 0.1
"""Deviations of reward below which a curve says nothing."""


@dataclass(frozen=True, eq=False)
class Curve:
    """What one descriptor adds to the reward of a step, over what was judged, or is
    usual where the model keeps no such range."""

    name: str
    unit: str
    values: np.ndarray
    """[K] of the descriptor, in its unit"""
    reward: np.ndarray
    """[K] in standard deviations of the reward, 0 in the mean"""
    spread: np.ndarray
    """[K] standard deviation over the ensemble"""

    @property
    def weight(self) -> float:
        """Between the best and the worst value."""
        return float(np.ptp(self.reward))


def learned_curves(
    model: RewardModel, *, control_dt_s: float, count: int = 6
) -> tuple[Curve, ...]:
    """The curves that matter most, first the one that does most; none of a model that
    is no sum over descriptors.

    Args:
        model: The reward.
        control_dt_s: Of the steps, for the unit of the stride rate.
        count: How many at most.
    """
    names, units = list(model.names), list(units_seen(model.provenance.cfg.sight))
    centre, unit = model.normaliser.mean, model.normaliser.std
    place = torch.linspace(0, 1, _POINTS)[:, None]
    match model.payer, model.scorer:
        case _, LinearScorer() as scorer:
            signed = torch.tensor([name in _SIGNED for name in names])
            least = torch.where(signed, -torch.inf, -centre / unit)
            low = least.clamp_min(-_USUAL).clamp_max(_USUAL)
            values = low + place * (_USUAL - low)
            added = values * scorer.weights[:, None]
            paid = added.mean(dim=0)
        case SparseScorer() as payer, SparseScorer() as scorer:
            low, high = scorer.judged
            values = low + place * (high - low)
            places = place.expand(-1, values.shape[1])
            added, paid = scorer.along(places), payer.along(places)[0]
            names, units = [*names, "stride_rate"], [*units, "Hz"]
            rates = torch.stack([scorer.rate_mean, scorer.rate_std]) / control_dt_s
            centre = torch.cat([centre, rates[:1]])
            unit = torch.cat([unit, rates[1:]])
        case _:
            return ()
    shown = values * unit + centre
    mean = (paid - paid.mean(dim=0)) / model.reward_std
    spread = ((added - added.mean(dim=1, keepdim=True)) / model.reward_std).std(dim=0)
    weights = mean.amax(dim=0) - mean.amin(dim=0)
    chosen = [
        i for i in weights.argsort(descending=True)[:count] if weights[i] > _LEAST
    ]
    return tuple(
        Curve(names[i], units[i], *(_plain(t[:, i]) for t in (shown, mean, spread)))
        for i in map(int, chosen)
    )


def _plain(values: Tensor) -> np.ndarray:
    return values.cpu().numpy().astype(float)
