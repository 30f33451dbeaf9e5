"""Answers that look wrong to a reward that has not seen them.

Where raters err at random, an answer that a reward fitted to the others thinks unlikely
may be one of their errors (RIME: Cheng et al. 2024, "RIME: Robust Preference-based
Reinforcement Learning with Noisy Preferences", filters them by such a likelihood). It
may as well be what the reward has not understood yet, so none is left out by default.

Shapes: B pairs.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from rewardmodel.cfg import FitCfg
from rewardmodel.measures.held_out import prediction_without
from rewardmodel.prepared.prepared import Prepared

_RANDOM = 0.98
"""Share of random answers, all but 1, from which on nothing is learned of one."""


def likelihoods(prepared: Prepared, cfg: FitCfg, *, seed: int) -> Tensor:
    """Probability [B] of each answer, 0.5 of a tie, as models foresee it that are
    fitted to all but a group of them, `cfg.folds` in all.

    Args:
        prepared: The answers.
        cfg: A fit whose settings are found already.
        seed: Which answers are a group, bootstrap draws and first weights.
    """
    target = prepared.described.target
    generator = torch.Generator().manual_seed(seed)
    group = torch.randperm(len(target), generator=generator) % cfg.folds
    left = torch.empty(len(target))
    for number in range(cfg.folds):
        tested = group == number
        opinion = prediction_without(prepared, ~tested, tested, cfg, seed)
        left[tested] = opinion.logit.sigmoid().to(left.dtype)
    return target * left + (1 - target) * (1 - left)


def without_doubted(
    prepared: Prepared, cfg: FitCfg, *, seed: int
) -> tuple[Prepared, int]:
    """The pairs with answers less likely than the filter's limit taken for random, and
    how many these are.

    They stay among the answers, so that a reward is still measured by them: it would be
    right about all that is left if whatever it gets wrong were left out. Held-out
    answers have a say in which of the others are doubted, and in nothing else.
    """
    assert cfg.label_filter is not None
    doubted = likelihoods(prepared, cfg, seed=seed) < cfg.label_filter.below
    errors = prepared.described.errors
    share = torch.where(doubted, _RANDOM, errors.share)
    return prepared.with_errors(replace(errors, share=share)), int(doubted.sum())
