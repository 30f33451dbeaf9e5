"""A reward of curves that go on rising where the judged clips ended.

Beyond what was judged a curve is flat, because no answer says whether it is too much.
A policy then stops at the edge: of a high step, at the highest that any clip showed. So
where somebody is asked afterwards, a curve that still rises at an end of the judged
range goes on a little; what is found there is judged next (optimism in the face of
uncertainty, Lai and Robbins 1985).

Shapes: T steps, N sequences, F features, G curves.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from .model import RewardModel
from .sparse import SparseScorer

_STEP = 0.25
"""Share of the judged range over which the rise at its end is measured."""


@dataclass(frozen=True, eq=False)
class RisingReward:
    """A reward function: what `model`, a sum of curves, pays, and more beyond."""

    model: RewardModel
    beyond: float
    """Share of the judged range by which a rising curve goes on."""

    @property
    def history_steps(self) -> int:
        """Steps before a step that matter to its reward."""
        return self.model.history_steps

    def __call__(self, features: Tensor, starts: Tensor) -> Tensor:
        """Reward [T, N] for rows [T, N, F], in units of the model's."""
        scorer = self.model.payer
        assert isinstance(scorer, SparseScorer)
        steps = self.model.standardised(features).transpose(0, 1)
        places = scorer.places(steps, starts.bool().mT)
        paid = scorer.paid(places.clamp(0, 1)).mean(dim=0)
        above, below = rises(scorer)
        over = (places - 1).clamp(0, self.beyond) @ above
        under = (-places).clamp(0, self.beyond) @ below
        return self.model.centred((paid + over + under).mT)

    def spread(self, features: Tensor, starts: Tensor) -> Tensor:
        """As the model's own."""
        return self.model.spread(features, starts)


def rises(scorer: SparseScorer) -> tuple[Tensor, Tensor]:
    """Raw reward [G] that the mean curve gains over its judged range at the rate of its
    upper end, and, going down, of its lower end; 0 where it falls there."""
    ends = torch.tensor([1.0, 1 - _STEP, 0.0, _STEP], device=scorer.judged.device)
    worth = scorer.at(ends[:, None].expand(-1, scorer.judged.shape[1])).mean(dim=0)
    return (
        ((worth[0] - worth[1]) / _STEP).clamp_min(0),
        ((worth[2] - worth[3]) / _STEP).clamp_min(0),
    )
