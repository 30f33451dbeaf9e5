"""Pairs that nobody answered, where the reward is sure of itself.

After SURF (Park et al. 2022, "SURF: Semi-supervised Reward Learning with Data
Augmentation for Feedback-efficient Preference-based RL"): a reward fitted to the
answers is asked about other pairs of the same data sets; where it is confident, its
opinion counts as an answer, though for less than one, and the reward is fitted again.

Shapes: B answered pairs, U pairs nobody answered, T steps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from rewardmodel.answers.likelihood import Errors
from rewardmodel.cfg import FitCfg
from rewardmodel.prepared.described import DescribedPairs


@dataclass(frozen=True, eq=False)
class Unanswered:
    """Described pairs without answers; their targets mean nothing."""

    pairs: DescribedPairs
    """[U]."""
    folds: Tensor
    """[U, 2] group of the episode of either clip."""

    def without(self, fold: int) -> Unanswered:
        """The pairs with no clip in a fold that is being held out."""
        kept = (self.folds != fold).all(dim=1)
        return Unanswered(self.pairs.subset(kept), self.folds[kept])


def with_opinions(
    pairs: DescribedPairs, unanswered: DescribedPairs, leads: Tensor, cfg: FitCfg
) -> DescribedPairs:
    """`pairs` and, behind them, those of `unanswered` on which the ensemble agrees.

    Args:
        pairs: [B].
        unanswered: [U].
        leads: [M, U] logits of the ensemble's members for `unanswered`.
        cfg: From which confidence on an opinion counts, and for how little.
    """
    assert cfg.semi_supervised is not None
    # The mean of the members' probabilities: sure only where they agree.
    probability = leads.sigmoid().mean(dim=0)
    surest = torch.maximum(probability, 1.0 - probability)
    sure = surest >= cfg.semi_supervised.confidence
    opinions = unanswered.subset(sure)
    count = len(opinions)
    opinions = replace(
        opinions,
        target=(probability[sure] > 0.5).to(pairs.target.dtype),
        errors=Errors.alike(
            cfg.semi_supervised.error_share, count, tie_threshold=cfg.tie_threshold
        ),
    )
    return pairs.joined(opinions) if count else pairs
