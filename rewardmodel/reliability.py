"""How reliable each rater is, estimated together with the reward.

A rater does not look in a share of the answers, and then says left, right or equal as
often as in all of them: so one who answers at random, or always the same, is found out
and counts for next to nothing (after Dawid and Skene 1979, with a reward in place of
true labels). The shares are those that make all answers most probable, all rewards
being averaged over: one fitted to an answer agrees with it too readily, one kept from
it has too few others where questions are hard.

Who looks and what is wanted depend on each other, and a search ends near where it
starts. So there are several: from everybody alike, and from one rater being the only
one who looks, for each who answered much. The most probable end is taken.

Shapes: B answers, R raters; stacked values [3, B] are left, right, tie.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import torch
from torch import Tensor

from .cfg import FitCfg, ReliabilityCfg, SparseCfg
from .evidence import ERROR_SHARES, expected_share
from .likelihood import Errors, answer_weights
from .sparse_fit import looks
from .training import TrainingPairs
from .views import Look, View, linear_look

SHARES = (*ERROR_SHARES, 0.95)
"""What is tried. One who answers at random says now and then what would be meant."""
_ALIKE = 10.0
"""Answers, as many of each kind, that are expected of a rater besides those given."""
HARDLY_LOOKS = 0.7
"""Share of random answers from which on those of a rater do not measure a reward."""
_BELIEVED = 0.2
"""Largest share that the most reliable rater counts with."""
_ROUNDS = 3
"""Times at most that shares, and what explains the answers, are found in turn."""
_SWEEPS = 3
"""Times at most that each rater's share is found beside those of the others."""
_REFINED = 2
"""Ends of searches that are gone on from, with what explains the answers found anew for
every share."""
_CROWD = 8
"""Raters up to whom that is done: more of them say together what explains the answers,
whatever one of them does."""
_STARTS = 4
"""Raters, those who answered most, each of whom a search starts at."""
_PLENTY = 400
"""Answers from which on every second, third, ... of each rater is looked at."""

Shares = tuple[float, ...]
"""[R] of the answers of each rater, given without looking."""


@dataclass(frozen=True, eq=False)
class Judged:
    """Answers, and what was found of those who gave them."""

    pairs: TrainingPairs
    """The answers, with the errors of their raters."""
    cfg: FitCfg
    """The settings of the fit, where these were still to be found with what was."""
    raters: tuple[tuple[str, float], ...]
    """Name of each rater, and the share of answers given without looking; nobody where
    one rater answered."""
    measuring: Tensor
    """[B] bool, whether an answer says how good a reward is: not of raters who hardly
    look, beside others. Foreseen at chance, they would hide what it is right about."""


def judge(pairs: TrainingPairs, raters: Sequence[str], cfg: FitCfg) -> Judged:
    """How often each of several raters errs, and what of `cfg` this decides.

    They are judged by curves where `cfg` asks for these or leaves the model open, else
    by linear weights: to weights that cannot say what is wanted everybody seems to
    answer at random. Which curves may matter is found with it, where it is open. One
    rater can be compared with nobody, and nothing is changed.

    Args:
        pairs: The answers, described, and expected to err as `cfg` says.
        raters: Who gave each.
        cfg: How a reward is fitted.
    """
    names = sorted(set(raters))
    if len(names) < 2 or not cfg.reliability.enabled:
        return Judged(pairs, cfg, (), torch.ones(len(pairs), dtype=torch.bool))
    of = torch.tensor([names.index(rater) for rater in raters])
    habits = _habits(pairs, of, len(names), cfg)
    sparse, found = _most_probable(pairs, of, habits, cfg)
    believed = _believed(found) if _by_curves(cfg) else found
    errors = _errors(believed, of, habits)
    share = torch.tensor(found)[of]
    measuring = share < HARDLY_LOOKS
    if not measuring.any():
        measuring = torch.ones_like(measuring)
    if cfg.adapt and cfg.kind == "sparse":
        usual = min(share[measuring].mean().item(), ERROR_SHARES[-1])
        cfg = replace(cfg, adapt=False, error_share=usual, sparse=sparse)
    shares = tuple(zip(names, found, strict=True))
    return Judged(replace(pairs, errors=errors), cfg, shares, measuring)


def _by_curves(cfg: FitCfg) -> bool:
    return cfg.kind in ("sparse", "auto")


def _most_probable(
    pairs: TrainingPairs, of: Tensor, habits: Tensor, cfg: FitCfg
) -> tuple[SparseCfg, Shares]:
    """Settings of the curves, `cfg`'s where raters are not judged by these, and
    shares."""
    some = _some(of)
    pairs, of = pairs.subset(some), of[some]
    if _by_curves(cfg):
        standardised, options = looks(pairs, cfg)
    else:
        standardised, look = linear_look(pairs, cfg)
        options = {cfg.sparse: look}
    answers = _Answers(pairs=standardised, of=of, habits=habits, cfg=cfg)
    searches = {sparse: _Search(answers, look) for sparse, look in options.items()}
    sparse = max(searches, key=lambda each: searches[each].log_odds)
    return sparse, searches[sparse].refined()


@dataclass(frozen=True, kw_only=True, eq=False)
class _Answers:
    """What some raters said."""

    pairs: TrainingPairs
    """Standardised."""
    of: Tensor
    """[B] number of who answered."""
    habits: Tensor
    """[3, R] how often each says left, right and equal."""
    cfg: FitCfg

    def erring(self, shares: Shares) -> TrainingPairs:
        """The answers, as raters give them who err as often as `shares` say."""
        return replace(self.pairs, errors=_errors(shares, self.of, self.habits))

    def log_odds(self, view: View, shares: Shares) -> float:
        """Of the answers, the weights of `view` and the shares, up to a constant."""
        expected = _expected(shares, self.cfg.reliability)
        return view.log_odds(self.erring(shares), self.cfg) + expected

    def starts(self) -> Iterator[Shares]:
        """Everybody alike, and each who answered much the only one who looks."""
        usual, num_raters = self.cfg.reliability.error_share, self.habits.shape[1]
        yield (usual,) * num_raters
        answers = self.of.bincount(minlength=num_raters)
        for one in answers.argsort(descending=True, stable=True)[:_STARTS].tolist():
            yield tuple(usual if r == one else SHARES[-1] for r in range(num_raters))


class _Search:
    """The most probable shares, as one way of looking at answers finds them."""

    def __init__(self, answers: _Answers, look: Look) -> None:
        self._answers = answers
        self._look = look
        self._seen: dict[Shares, tuple[View, float]] = {}
        ends = {self._end_of(start) for start in answers.starts()}
        self._ends = sorted(ends, key=self._odds_at, reverse=True)

    @property
    def log_odds(self) -> float:
        """Of the best end, up to a constant."""
        return self._odds_at(self._ends[0])

    def refined(self) -> Shares:
        """The best near the most probable ends, looked at anew for every share; of a
        crowd, the best end."""
        if len(self._ends[0]) > _CROWD:
            return self._ends[0]
        found = [_climbed(self._odds_at, end) for end in self._ends[:_REFINED]]
        return max(found, key=self._odds_at)

    def _odds_at(self, shares: Shares) -> float:
        return self._at(shares)[1]

    def _at(self, shares: Shares) -> tuple[View, float]:
        if shares not in self._seen:
            view = self._look(self._answers.erring(shares))
            self._seen[shares] = view, self._answers.log_odds(view, shares)
        return self._seen[shares]

    def _end_of(self, shares: Shares) -> Shares:
        """Shares and what explains the answers, found in turn."""
        visited = [shares]
        for _ in range(_ROUNDS):
            view = self._at(shares)[0]
            shares = _climbed(partial(self._answers.log_odds, view), shares)
            if shares in visited:
                break
            visited.append(shares)
        return max(visited, key=self._odds_at)


def _climbed(height: Callable[[Shares], float], shares: Shares) -> Shares:
    """From `shares` on, one rater's changed at a time, or all to the same, as long as
    it gets higher."""
    best = height(shares)
    for _ in range(_SWEEPS):
        before = shares
        for rater in range(len(shares)):
            for share in SHARES:
                other = (*shares[:rater], share, *shares[rater + 1 :])
                if (found := height(other)) > best:
                    best, shares = found, other
        for share in SHARES:
            alike = (share,) * len(shares)
            if (found := height(alike)) > best:
                best, shares = found, alike
        if shares == before:
            break
    return shares


def _errors(shares: Shares, of: Tensor, habits: Tensor) -> Errors:
    """Errors of the answers of raters `of` [B]."""
    return Errors(torch.tensor(shares)[of], habits[:, of])


def _habits(pairs: TrainingPairs, of: Tensor, num_raters: int, cfg: FitCfg) -> Tensor:
    """How often each rater says left, right and equal, [3, R]."""
    said = answer_weights(pairs.target, tie_threshold=cfg.tie_threshold)
    alike = Errors.alike(0.0, num_raters, tie_threshold=cfg.tie_threshold).guess
    sums = (_ALIKE * alike).index_add(1, of, said)
    return sums / sums.sum(dim=0)


def _expected(shares: Shares, cfg: ReliabilityCfg) -> float:
    """Logarithm, up to a constant, of how probable shares are before any answer.

    One share is everybody's: a wish that is hard to say makes all seem to err alike.
    Who has another is an exception.
    """
    return max(
        expected_share(common, cfg.error_share)
        + sum(math.log(cfg.careless) for share in shares if share != common)
        for common in SHARES
    )


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
