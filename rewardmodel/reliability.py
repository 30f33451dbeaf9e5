"""How reliable each rater is, estimated together with the reward.

A rater errs in a share of the answers, and then says left, right or equal with habits
of their own: so one who answers at random, or always the same, is found out and counts
for next to nothing (after Dawid and Skene 1979, with a reward in place of true labels).

Shapes: B answers; stacked values [3, B] are left, right, tie.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from .cfg import FitCfg
from .held_out import opinion_without
from .likelihood import (
    Errors,
    answer_log_probabilities,
    answer_weights,
)
from .training import TrainingPairs

_FOLDS = 5
_PASSES = 20
_MAX_SHARE = 0.98
_MEMBERS = 4
"""Of a sum of curves that raters are compared with: it is fitted a dozen times."""


def with_reliability(
    pairs: TrainingPairs, raters: Sequence[str], cfg: FitCfg, *, seed: int
) -> tuple[TrainingPairs, tuple[tuple[str, float], ...]]:
    """`pairs` with the errors of their raters, and the share of each by name.

    Reward and errors are estimated in turn. An answer is judged by a reward that has
    not seen it: one that has would agree with everybody. It is a sum of curves where
    `cfg` asks for one, else linear: to weights that cannot say what is wanted everybody
    seems to answer at random. With one rater nothing can be compared, and nothing is
    changed.
    """
    names = sorted(set(raters))
    if len(names) < 2 or not cfg.reliability.enabled:
        return pairs, ()
    judge = _judge(cfg)
    of = torch.tensor([names.index(rater) for rater in raters])
    for _ in range(cfg.reliability.rounds):
        leads = _cross_fitted(pairs, judge, seed)
        pairs = replace(pairs, errors=_estimated(pairs, leads, of, len(names), cfg))
    firsts = [int((of == index).nonzero()[0]) for index in range(len(names))]
    shares = pairs.errors.share[firsts].tolist()
    return pairs, tuple(zip(names, shares, strict=True))


def _judge(cfg: FitCfg) -> FitCfg:
    """The settings of the reward that answers are compared with."""
    if cfg.kind != "sparse":
        return replace(cfg, kind="linear")
    return replace(cfg, sparse=replace(cfg.sparse, num_members=_MEMBERS, shared=False))


def _cross_fitted(pairs: TrainingPairs, cfg: FitCfg, seed: int) -> Tensor:
    """Lead [B] of each pair by rewards fitted without its answer."""
    generator = torch.Generator().manual_seed(seed)
    fold = torch.randperm(len(pairs), generator=generator) % _FOLDS
    leads = torch.zeros(len(pairs))
    for left_out in range(_FOLDS):
        fitted, asked = fold != left_out, fold == left_out
        if fitted.any() and asked.any():
            opinion = opinion_without(pairs, fitted, asked, cfg, seed)
            leads[asked] = opinion.lead.to(leads.dtype)
    return leads


def _estimated(
    pairs: TrainingPairs, leads: Tensor, of: Tensor, num_raters: int, cfg: FitCfg
) -> Errors:
    """Errors of every answer by expectation-maximisation, the leads [B] being given.

    Args:
        pairs: The answers.
        leads: What a reward foresees.
        of: [B] number of the rater who answered.
        num_raters: How many raters there are.
        cfg: The prior: errors as often as `error_share`, guesses spread evenly.
    """
    weights = answer_weights(pairs.target, tie_threshold=cfg.tie_threshold)
    log_p = answer_log_probabilities(
        leads, tie_threshold=cfg.tie_threshold, error_share=0.0
    )
    prior = cfg.reliability.prior_answers
    alike = Errors.alike(cfg.error_share, num_raters, tie_threshold=cfg.tie_threshold)
    by_rater = alike
    count = torch.bincount(of, minlength=num_raters)
    for _ in range(_PASSES):
        share, guess = by_rater.share[of], by_rater.guess[:, of]
        meant = (1 - share) * log_p.exp()
        random = share * guess
        # Of each kind of answer, the share that was random.
        blamed = weights * random / (meant + random).clamp_min(1e-12)
        sums = torch.zeros(3, num_raters).index_add_(1, of, blamed)
        new_share = (prior * cfg.error_share + sums.sum(dim=0)) / (prior + count)
        habits = prior * cfg.error_share * alike.guess + sums
        by_rater = Errors(
            new_share.clamp(0.0, _MAX_SHARE),
            habits / habits.sum(dim=0).clamp_min(1e-12),
        )
    return by_rater.part(of)
