"""The shares of random answers that make all answers of several raters most probable.

Who looks and what is wanted depend on each other, and a search ends near where it
starts. So there are several: from everybody alike, and from one rater being the only
one who looks, for each who answered much. The most probable end is taken.

Shapes: B answers, R raters; stacked values [3, B] are left, right, tie.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import torch
from torch import Tensor

from .cfg import FitCfg, ReliabilityCfg
from .hypothesis import Explain, Hypothesis
from .likelihood import Errors
from .noise_level import ERROR_SHARES, expected_share
from .training import StandardisedPairs

SHARES = (*ERROR_SHARES, 0.95)
"""What is tried. One who answers at random says now and then what would be meant."""
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

Shares = tuple[float, ...]
"""[R] of the answers of each rater, given without looking."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RaterAnswers:
    """What some raters said."""

    pairs: StandardisedPairs
    of: Tensor
    """[B] number of who answered."""
    habits: Tensor
    """[3, R] how often each says left, right and equal."""
    cfg: FitCfg

    def erring(self, shares: Shares) -> StandardisedPairs:
        """The answers, as raters give them who err as often as `shares` say."""
        return replace(self.pairs, errors=errors_of(shares, self.of, self.habits))

    def log_odds(self, hypothesis: Hypothesis, shares: Shares) -> float:
        """Of the answers, the hypothesis and the shares, up to a constant."""
        expected = _expected(shares, self.cfg.reliability)
        return hypothesis.log_odds(self.erring(shares), self.cfg) + expected

    def starts(self) -> Iterator[Shares]:
        """Everybody alike, and each who answered much the only one who looks."""
        usual, num_raters = self.cfg.reliability.error_share, self.habits.shape[1]
        yield (usual,) * num_raters
        answers = self.of.bincount(minlength=num_raters)
        for one in answers.argsort(descending=True, stable=True)[:_STARTS].tolist():
            yield tuple(usual if r == one else SHARES[-1] for r in range(num_raters))


class ShareSearch:
    """The most probable shares, as one way of looking at answers finds them."""

    def __init__(self, answers: RaterAnswers, explain: Explain) -> None:
        self._answers = answers
        self._explain = explain
        self._seen: dict[Shares, tuple[Hypothesis, float]] = {}
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

    def _at(self, shares: Shares) -> tuple[Hypothesis, float]:
        if shares not in self._seen:
            hypothesis = self._explain(self._answers.erring(shares))
            self._seen[shares] = hypothesis, self._answers.log_odds(hypothesis, shares)
        return self._seen[shares]

    def _end_of(self, shares: Shares) -> Shares:
        """Shares and what explains the answers, found in turn."""
        visited = [shares]
        for _ in range(_ROUNDS):
            hypothesis = self._at(shares)[0]
            shares = _climbed(partial(self._answers.log_odds, hypothesis), shares)
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


def errors_of(shares: Shares, of: Tensor, habits: Tensor) -> Errors:
    """Errors of the answers of raters `of` [B]."""
    return Errors(torch.tensor(shares)[of], habits[:, of])


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
