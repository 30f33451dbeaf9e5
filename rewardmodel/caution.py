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

from torch import Tensor

from .model import RewardModel


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

    def __call__(self, features: Tensor, starts: Tensor) -> Tensor:
        """Reward [T, N] for rows [T, N, F], in units of the model's."""
        members = self.model.members(features, starts)
        paid = members.mean(dim=0) - self.caution * members.std(dim=0)
        return (paid - self.model.reward_mean) / self.model.reward_std

    def spread(self, features: Tensor, starts: Tensor) -> Tensor:
        """As the model's own."""
        return self.model.spread(features, starts)
