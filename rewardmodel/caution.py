"""A reward that is less sure pays less: the mean of the ensemble less its spread.

A policy looks for what the reward overrates. Where members fitted to resampled answers
disagree, the answers do not say what a motion is worth; paying the mean less some
deviations there takes the gain out of leaving what was judged (lower confidence bound;
for learned rewards Coste et al. 2023, "Reward Model Ensembles Help Mitigate
Overoptimization").

Shapes: T steps, N sequences, F features.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from torch import Tensor

from .model import RewardModel

FEW_ERRORS, MANY_ERRORS = 0.1, 0.2
"""Shares of random answers between which caution sets in."""


@dataclass(frozen=True, eq=False)
class CautiousReward:
    """A reward function: what `model` pays, less `caution` deviations of its ensemble.

    A negative caution pays for what is not known yet.
    """

    model: RewardModel
    caution: float
    """Standard deviations of the ensemble taken off every step's reward."""

    @property
    def history_steps(self) -> int:
        """Steps before a step that matter to its reward."""
        return self.model.history_steps

    @classmethod
    def where_answers_err(cls, model: RewardModel, most: float) -> Self:
        """Caution by the share of random answers that `model` was fitted to expect:
        none up to `FEW_ERRORS`, `most` from `MANY_ERRORS` on.

        Where answers can be believed, caution costs more than it saves: a reward is
        surest of standing still.
        """
        share = model.provenance.cfg.error_share
        doubt = (share - FEW_ERRORS) / (MANY_ERRORS - FEW_ERRORS)
        return cls(model, most * min(1.0, max(0.0, doubt)))

    def __call__(self, features: Tensor, starts: Tensor) -> Tensor:
        """Reward [T, N] for rows [T, N, F], in units of the model's."""
        members = self.model.members(features, starts)
        paid = members.mean(dim=0) - self.caution * members.std(dim=0)
        return (paid - self.model.reward_mean) / self.model.reward_std

    def spread(self, features: Tensor, starts: Tensor) -> Tensor:
        """As the model's own."""
        return self.model.spread(features, starts)
