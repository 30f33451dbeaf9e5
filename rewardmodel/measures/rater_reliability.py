"""How reliable each rater is, estimated together with the reward.

A rater does not look in a share of the answers, and then says left, right or equal as
often as in all of them: so one who answers at random, or always the same, is found out
and counts for next to nothing (after Dawid and Skene 1979, with a reward in place of
true labels). The shares are those that make all answers most probable, all rewards
being averaged over: one fitted to an answer agrees with it too readily, one kept from
it has too few others where questions are hard.

Shapes: B answers, R raters; stacked values [3, B] are left, right, tie.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from rewardmodel.answers.answered_pairs import AnsweredPairs
from rewardmodel.answers.likelihood import HARDLY_LOOKS, Errors, guesses_of
from rewardmodel.cfg import FitCfg
from rewardmodel.models.kinds import prepare_closely
from rewardmodel.posterior.fit_posterior import shares_of_raters
from rewardmodel.prepared.prepared import Prepared

_PLENTY = 400
"""Answers from which on every second, third, ... of each rater is looked at."""


@dataclass(frozen=True, eq=False)
class Judged:
    """Answers, and what was found of those who gave them."""

    prepared: Prepared
    """The answers, with the errors of their raters."""
    raters: tuple[tuple[str, float], ...]
    """Name of each rater, and the share of answers given without looking; nobody where
    one rater answered."""
    measuring: Tensor
    """[B] bool, whether an answer says how good a reward is: not of raters who hardly
    look, beside others. Foreseen at chance, they would hide what it is right about."""


def judge(prepared: Prepared, pairs: AnsweredPairs, cfg: FitCfg) -> Judged:
    """How often each of several raters errs. One can be compared with nobody, and
    nothing is changed.

    Whatever a reward sees, raters are told apart by opinions about all there is.

    Args:
        prepared: The answers, as the reward sees them.
        pairs: The same answers.
        cfg: How a reward is fitted.
    """
    raters = pairs.raters
    names = sorted(set(raters))
    if len(names) < 2 or not cfg.reliability.enabled:
        return Judged(prepared, (), torch.ones(len(prepared), dtype=torch.bool))
    of = torch.tensor([names.index(rater) for rater in raters])
    target = prepared.described.target
    habits = guesses_of(target, of, len(names), tie_threshold=cfg.tie_threshold)
    share = torch.full((len(of),), cfg.error_share)
    errors, some = Errors(share, habits[:, of], of), _some(of)
    if prepared.clips.pool is None:
        seen = prepare_closely(pairs.subset(some), cfg)
    else:
        seen = prepared.subset(some)
    found = shares_of_raters(seen.with_errors(errors.part(some)), cfg)
    share = torch.tensor(found)[of]
    measuring = share < HARDLY_LOOKS
    if not measuring.any():
        measuring = torch.ones_like(measuring)
    errors = Errors(share, habits[:, of], of)
    shares = tuple(zip(names, found, strict=True))
    return Judged(prepared.with_errors(errors), shares, measuring)


def _some(of: Tensor) -> Tensor:
    """[B] bool, every second, third, ... answer of each rater where there are many."""
    place = torch.empty_like(of)
    for rater in of.unique():
        own = of == rater
        place[own] = torch.arange(int(own.sum()))
    return place % -(-len(of) // _PLENTY) == 0
