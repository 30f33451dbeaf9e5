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

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from .cfg import FitCfg, SparseCfg
from .hypothesis import linear_hypothesis
from .likelihood import Errors, answer_weights
from .noise_level import ERROR_SHARES
from .prepared import Prepared
from .rater_shares import RaterAnswers, Shares, ShareSearch, errors_of
from .sparse_fit import curve_hypotheses

HARDLY_LOOKS = 0.7
"""Share of random answers from which on those of a rater do not measure a reward."""
_ALIKE = 10.0
"""Answers, as many of each kind, that are expected of a rater besides those given."""
_BELIEVED = 0.2
"""Largest share that the most reliable rater counts with."""
_PLENTY = 400
"""Answers from which on every second, third, ... of each rater is looked at."""


@dataclass(frozen=True, eq=False)
class Judged:
    """Answers, and what was found of those who gave them."""

    prepared: Prepared
    """The answers, with the errors of their raters."""
    cfg: FitCfg
    """The settings of the fit, where these were still to be found with what was."""
    raters: tuple[tuple[str, float], ...]
    """Name of each rater, and the share of answers given without looking; nobody where
    one rater answered."""
    measuring: Tensor
    """[B] bool, whether an answer says how good a reward is: not of raters who hardly
    look, beside others. Foreseen at chance, they would hide what it is right about."""


def judge(
    prepared: Prepared, raters: Sequence[str], cfg: FitCfg, *, by_curves: bool
) -> Judged:
    """How often each of several raters errs, and what of `cfg` this decides.

    To weights that cannot say what is wanted everybody seems to answer at random. Which
    curves may matter is found with it, where it is open. One rater can be compared with
    nobody, and nothing is changed.

    Args:
        prepared: The answers, expected to err as `cfg` says.
        raters: Who gave each.
        cfg: How a reward is fitted.
        by_curves: Whether raters are judged by curves, else by linear weights.
    """
    names = sorted(set(raters))
    if len(names) < 2 or not cfg.reliability.enabled:
        return Judged(prepared, cfg, (), torch.ones(len(prepared), dtype=torch.bool))
    of = torch.tensor([names.index(rater) for rater in raters])
    habits = _habits(prepared.described.target, of, len(names), cfg)
    some = _some(of)
    sparse, found = _most_probable(
        prepared.subset(some), of[some], habits, cfg, by_curves
    )
    believed = _believed(found) if by_curves else found
    errors = errors_of(believed, of, habits)
    share = torch.tensor(found)[of]
    measuring = share < HARDLY_LOOKS
    if not measuring.any():
        measuring = torch.ones_like(measuring)
    if cfg.adapt and by_curves:
        usual = min(share[measuring].mean().item(), ERROR_SHARES[-1])
        cfg = replace(cfg, adapt=False, error_share=usual, sparse=sparse)
    shares = tuple(zip(names, found, strict=True))
    return Judged(prepared.with_errors(errors), cfg, shares, measuring)


def _most_probable(
    prepared: Prepared, of: Tensor, habits: Tensor, cfg: FitCfg, by_curves: bool
) -> tuple[SparseCfg, Shares]:
    """Settings of the curves, `cfg`'s where raters are not judged by these, and
    shares."""
    seen = prepared.seen_by("legs" if by_curves else "habits")
    if by_curves:
        options = curve_hypotheses(seen, cfg)
    else:
        options = {cfg.sparse: linear_hypothesis(seen, cfg)}
    answers = RaterAnswers(pairs=seen.standardised, of=of, habits=habits, cfg=cfg)
    searches = {
        sparse: ShareSearch(answers, explain) for sparse, explain in options.items()
    }
    sparse = max(searches, key=lambda each: searches[each].log_odds)
    return sparse, searches[sparse].refined()


def _habits(target: Tensor, of: Tensor, num_raters: int, cfg: FitCfg) -> Tensor:
    """How often each rater says left, right and equal, [3, R]."""
    said = answer_weights(target, tie_threshold=cfg.tie_threshold)
    alike = Errors.alike(0.0, num_raters, tie_threshold=cfg.tie_threshold).guess
    sums = (_ALIKE * alike).index_add(1, of, said)
    return sums / sums.sum(dim=0)


def _believed(shares: Shares) -> Shares:
    """`shares`, the odds of all of them lowered alike until somebody is believed.

    No curve is taken that answers speak for which all count as random. Who is to be
    believed more than the others is known even where the answers could be chance;
    whether they are, held-out answers say.
    """
    found = torch.tensor(shares).logit()
    most = torch.tensor(_BELIEVED).logit()
    return tuple((found - (found.min() - most).clamp_min(0.0)).sigmoid().tolist())


def _some(of: Tensor) -> Tensor:
    """[B] bool, every second, third, ... answer of each rater where there are many."""
    place = torch.empty_like(of)
    for rater in of.unique():
        own = of == rater
        place[own] = torch.arange(int(own.sum()))
    return place % -(-len(of) // _PLENTY) == 0
