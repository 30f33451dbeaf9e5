"""What a reward that is a sum over descriptors makes of each of them.

Shapes: M ensemble members, K values, D descriptors, G curves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from rewardmodel.descriptors.row import Habit
from rewardmodel.descriptors.stride_rate import STRIDE_RATE
from rewardmodel.descriptors.table import columns_seen
from rewardmodel.models.model import RewardModel

_POINTS, _MOST = 41, 6
_USUAL = 2.0
"""Deviations to either side that a straight line is told for."""
_LEAST = 0.1
"""Deviations of reward below which a curve says nothing."""


@dataclass(frozen=True, eq=False)
class Curve:
    """What one habit adds to the reward of a step, over what was judged, or is usual
    where the model keeps no such range."""

    habit: Habit
    values: np.ndarray
    """[K] of the habit, in its unit"""
    reward: np.ndarray
    """[K] in standard deviations of the reward, 0 in the mean"""
    spread: np.ndarray
    """[K] standard deviation over the ensemble"""

    @property
    def weight(self) -> float:
        """Between the best and the worst value."""
        return float(np.ptp(self.reward))


def learned_curves(model: RewardModel, *, control_dt_s: float) -> tuple[Curve, ...]:
    """The curves that matter most, first the one that does most; none of a model that
    is no sum over descriptors.

    Args:
        model: The reward.
        control_dt_s: Of the steps, for the unit of the stride rate.
    """
    habits: list[Habit] = [*columns_seen(model.sight)]
    centre, unit = model.normaliser.mean, model.normaliser.std
    place = torch.linspace(0, 1, _POINTS)[:, None]
    signed = torch.tensor([habit.signed for habit in habits])
    least = torch.where(signed, -torch.inf, -centre / unit)
    low = least.clamp_min(-_USUAL).clamp_max(_USUAL)
    high = torch.full_like(low, _USUAL)
    found, agreed = (
        scorer.additive(place, low, high) for scorer in (model.scorer, model.payer)
    )
    if found is None or agreed is None:
        return ()
    added, paid = found.added, agreed.added.mean(dim=0)
    if found.rate is not None:
        habits.append(STRIDE_RATE)
        rates = torch.stack(found.rate) / control_dt_s
        centre = torch.cat([centre, rates[:1]])
        unit = torch.cat([unit, rates[1:]])
    shown = found.values * unit + centre
    mean = (paid - paid.mean(dim=0)) / model.reward_std
    spread = ((added - added.mean(dim=1, keepdim=True)) / model.reward_std).std(dim=0)
    weights = mean.amax(dim=0) - mean.amin(dim=0)
    chosen = [
        i for i in weights.argsort(descending=True)[:_MOST] if weights[i] > _LEAST
    ]
    drawn = [each.cpu().numpy().astype(float) for each in (shown, mean, spread)]
    return tuple(
        Curve(habits[i], *(each[:, i] for each in drawn)) for i in map(int, chosen)
    )
