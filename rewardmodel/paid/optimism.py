"""What a reward pays that hopes for the best of leaving what is known.

Who has only seen robots that stand and robots that tumble is surest of standing, and a
policy that stands shows nobody anything else. Members fitted to resampled answers
disagree about what standing is worth; a reward moved from their mean towards those who
think less of it, by some deviations, is still one the answers allow, and gets a robot
going (optimism where answers leave room; for sampled opinions Osband et al. 2013,
"(More) Efficient Reinforcement Learning via Posterior Sampling").

Shapes: M ensemble members, T steps, N sequences, F features.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor

from rewardmodel.models.model import RewardModel

_LEAST_SPREAD = 1e-6
"""Raw reward by which members must differ to disagree at all."""


@dataclass(frozen=True, eq=False)
class OptimisticReward:
    """A reward function: what the members of `model` pay, each by its share."""

    model: RewardModel
    shares: Tensor
    """[M], summing to 1; below 0 for members who think most of what is to be left."""
    lift: float = 0.0
    """Added to every step, in units of the model's."""

    @property
    def history_steps(self) -> int:
        """Steps before a step that matter to its reward."""
        return self.model.history_steps

    @classmethod
    def leaving(
        cls, model: RewardModel, features: Tensor, lengths: Tensor, deviations: float
    ) -> Self:
        """The reward that thinks `deviations` less of some motion than the mean does.

        Of a linear reward w with posterior covariance S it is the most likely one that
        pays the motion x as little: w - deviations S x / sqrt(x' S x).

        Answers about clips of one length leave open what a step is worth beside none.
        Every step is lifted so that the motion to be left goes on being paid what the
        mean pays, and nothing at least: where all that is known costs something, the
        way out is to fall at once.

        Args:
            model: The reward.
            features: [T, N, F] of the motion.
            lengths: [N] of its episodes.
            deviations: By how much of the members' standard deviation.
        """
        steps = torch.arange(len(features))[:, None]
        raw = model.members(features, (steps == 0).expand(features.shape[:2]))
        pay = raw[:, steps < lengths].mean(dim=1)
        apart, spread = pay - pay.mean(), pay.std()
        shares = torch.full_like(pay, 1 / len(pay))
        if len(pay) > 1 and spread > _LEAST_SPREAD:
            shares = shares - deviations * apart / ((len(pay) - 1) * spread)
        own, hoped = (float(model.centred(each)) for each in (pay.mean(), shares @ pay))
        return cls(model, shares, lift=max(own, 0.0) - hoped)

    def __call__(self, features: Tensor, starts: Tensor) -> Tensor:
        """Reward [T, N] for rows [T, N, F], in units of the model's."""
        raw = self.model.members(features, starts)
        hoped = torch.einsum("m,mtn->tn", self.shares, raw)
        return self.model.centred(hoped) + self.lift

    def spread(self, features: Tensor, starts: Tensor) -> Tensor:
        """Deviation [T, N] over the members, the model's own."""
        return self.model.spread(features, starts)
