"""A linear reward that is less sure pays less, habit by habit.

A policy looks for what the reward overrates. Where members fitted to resampled answers
disagree, the answers do not say what a motion is worth (for learned rewards Coste et
al. 2023, "Reward Model Ensembles Help Mitigate Overoptimization", who lower the whole
reward).

Where answers err, each weight is moved towards what was expected of it before any
answer, all the way where it lies within some deviations of that over the members, and
by less the surer it is, and effort is not paid for: what moves well takes more of it
than what stands, and such answers cannot tell the two apart. A bound on the whole
reward would also pay less for a habit that is surely good and goes with others in
doubt, and so prefer standing still.

Where they hardly err, a linear reward may charge in full and pay only what is surely
liked. What is charged ends at nothing; of what is paid a policy can have more than any
clip showed, and it finds those weights that chance made positive.

Shapes: M ensemble members, T steps, N sequences, F features, D descriptors.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from rewardmodel.descriptors.habits import EFFORT, named
from rewardmodel.linear.linear import LinearScorer
from rewardmodel.models.model import RewardModel


@dataclass(frozen=True, eq=False)
class CautiousReward:
    """A reward function: what a linear `model` pays, careful where its ensemble
    disagrees."""

    model: RewardModel
    caution: float = 0.0
    """Standard deviations of the ensemble by which every weight is doubted."""
    pays_effort: bool = True
    """Whether effort may be paid for."""
    sure: float = 0.0
    """Standard deviations of the ensemble that a weight must be above 0 to pay at
    all."""

    def __post_init__(self) -> None:
        _ = self._scorer

    @property
    def _scorer(self) -> LinearScorer:
        scorer = self.model.scorer
        if isinstance(scorer, LinearScorer):
            return scorer
        raise TypeError(
            "only a linear reward is paid weight by weight, this one is of kind "
            f"{self.model.provenance.cfg.kind}"
        )

    @property
    def history_steps(self) -> int:
        """Steps before a step that matter to its reward."""
        return self.model.history_steps

    def __call__(self, features: Tensor, starts: Tensor) -> Tensor:
        """Reward [T, N] for rows [T, N, F], in units of the model's."""
        if self.caution == 0.0 and self.pays_effort and self.sure == 0.0:
            return self.model(features, starts)
        paid = self.model.standardised(features) @ self._weights()
        return self.model.centred(paid)

    def _weights(self) -> Tensor:
        scorer = self._scorer
        weights = careful_weights(scorer, self.caution)
        if self.sure:
            weights = surely_paid(weights, self.sure * scorer.weights.std(dim=0))
        if self.pays_effort:
            return weights
        return torch.where(named(EFFORT), weights.clamp_max(0.0), weights)

    def spread(self, features: Tensor, starts: Tensor) -> Tensor:
        """Deviation [T, N] over the members, the model's own."""
        return self.model.spread(features, starts)


def careful_weights(scorer: LinearScorer, caution: float) -> Tensor:
    """One weight [D] for each habit, nearer to what was expected of it by its doubt.

    What is left is not raised: a robot that explores shakes, and where a reward makes
    much of that, falling at once is worth more than going on.
    """
    found = scorer.weights.mean(dim=0) - scorer.expected
    doubt = caution * scorer.weights.std(dim=0)
    return scorer.expected + found * sureness(found, doubt)


def surely_paid(weights: Tensor, doubt: Tensor) -> Tensor:
    """`weights` [D], those above 0 lowered: to 0 up to their `doubt` [D], and by less
    the surer they are."""
    return torch.where(weights > 0, weights * sureness(weights, doubt), weights)


def sureness(weights: Tensor, doubt: Tensor) -> Tensor:
    """Share [D] of `weights` [D] that their `doubt` [D] leaves: none up to it, and
    nearly all of what is far beyond it (non-negative garrote, Breiman 1995, "Better
    Subset Regression Using the Nonnegative Garrote").

    Taking the doubt itself off, as soft thresholding does, also lowers what is sure.
    """
    kept = 1 - (doubt / weights.abs().clamp_min(1e-12)).square()
    return kept.clamp_min(0.0)
