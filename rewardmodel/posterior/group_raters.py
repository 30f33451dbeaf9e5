"""Raters who want the same, told from those who want something else, and from errors.

Whether two raters want the same is a choice of models: one wish that explains both, or
one each (a Bayes factor, Kass and Raftery 1995). Errors are in all of them, so who
answers at random fits every group. Groups are joined, the surest first, until none is
more probable joined than apart. Whether one rater's wish has changed is asked alike of
the earlier and the later answers.

Shapes: B answers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations

import torch
from torch import Tensor

from data.files.telling import Tell, silent
from rewardmodel.answers.answered_pairs import AnsweredPairs
from rewardmodel.answers.likelihood import guesses_of
from rewardmodel.cfg import FitCfg
from rewardmodel.opinions.opinions import SHAPES, habit_of
from rewardmodel.opinions.pool import Pool
from rewardmodel.opinions.ranges import HABITS
from rewardmodel.prepared.described import describe_pairs

from .fit_posterior import answers_seen
from .sampler import Posterior, sampled

_ODDS_ALIKE = math.log(1000.0)
"""Logarithm of how much likelier it is, before any answer, that two want the same."""
_ENOUGH = 40
"""Answers of a rater that are looked at, of more as many, spread over all."""
_LEAST_TO_CHANGE = 12
"""Answers before and after a change of taste that can tell of it."""
_OF_A_CHANGE = 10
"""Wishes that are weighed to see whether one rater's has changed."""
_PARTICLES = 1000
_MOST_RATERS = 12
"""Who can be compared within minutes: every two are, those who answered most."""
_NAMED = 0.3
"""Share of the particles from which on a habit is named."""


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """A habit that somebody has an opinion about."""

    habit: str
    how: str
    """`more`, `less` or `a certain`."""
    probability: float


@dataclass(frozen=True, kw_only=True)
class Group:
    """Raters who want the same."""

    raters: tuple[str, ...]
    answers: int
    wanted: tuple[Wanted, ...]
    """The most probable first."""


@dataclass(frozen=True, kw_only=True)
class Changed:
    """A rater whose later answers want something else than the earlier ones."""

    rater: str
    after: int
    """Answers before the change."""
    log_odds: float
    """Logarithm of how much more probable two wishes are than one."""


@dataclass(frozen=True, kw_only=True)
class Grouping:
    """What is found of all raters."""

    groups: tuple[Group, ...]
    """The largest first."""
    changed: tuple[Changed, ...]
    untold: tuple[str, ...] = ()
    """Who answered least, beyond as many as can be compared."""

    def group_of(self, rater: str) -> Group | None:
        """The group that a rater is in; None of one that was not compared."""
        return next((group for group in self.groups if rater in group.raters), None)


def group_raters(
    pairs: AnsweredPairs,
    cfg: FitCfg,
    *,
    seed: int,
    tell: Tell = silent,
) -> Grouping:
    """Groups of those who answered `pairs`, and who of them has changed.

    Args:
        pairs: Answers, with their times where changes are looked for.
        cfg: What is expected of wishes and raters.
        seed: Every draw.
        tell: Gets the comparisons that are made; more are to be made with each group.
    """
    most = sorted(set(pairs.raters), key=lambda name: (-pairs.raters.count(name), name))
    names = sorted(most[:_MOST_RATERS])
    told = _Told(pairs, cfg, seed)
    # Each alone, every two together, and each at its changes.
    done, of = 0, len(names) * (len(names) + 1) // 2 + _OF_A_CHANGE * len(names)

    @cache
    def evidence(raters: frozenset[str]) -> float:
        nonlocal done
        tell(done, of)
        done += 1
        return told.posterior(told.rows(raters)).log_evidence

    def changed(name: str) -> Changed | None:
        nonlocal done
        tell(done, of)
        done += _OF_A_CHANGE
        return _change_of(told, name)

    groups = [frozenset({name}) for name in names]
    while len(groups) > 1:
        gain, first, second = max(
            (
                (evidence(a | b) - evidence(a) - evidence(b), a, b)
                for a, b in combinations(groups, 2)
            ),
            key=lambda each: each[0],
        )
        if gain + _ODDS_ALIKE <= 0:
            break
        groups = [g for g in groups if g not in (first, second)] + [first | second]
        of += len(groups) - 1
    found = [_described(told, group) for group in groups]
    return Grouping(
        groups=tuple(sorted(found, key=lambda g: (-len(g.raters), g.raters))),
        changed=tuple(filter(None, map(changed, names))),
        untold=tuple(sorted(most[_MOST_RATERS:])),
    )


class _Told:
    """Answers, described once, and what they say of any part of the raters."""

    def __init__(
        self,
        pairs: AnsweredPairs,
        cfg: FitCfg,
        seed: int,
    ) -> None:
        self.raters, self._cfg, self._seed = pairs.raters, cfg, seed
        times = pairs.times or ("",) * len(pairs)
        order = sorted(range(len(pairs)), key=lambda row: (times[row], row))
        self._place = {row: place for place, row in enumerate(order)}
        self.timed = bool(pairs.times)
        pool = Pool.of(pairs, told=cfg.posterior.told)
        described = describe_pairs(pairs, cfg, "legs")
        names = sorted(set(pairs.raters))
        rater = torch.tensor([names.index(name) for name in pairs.raters])
        threshold = cfg.tie_threshold
        guess = guesses_of(pairs.target, rater, len(names), tie_threshold=threshold)
        errors = replace(described.errors, guess=guess[:, rater])
        described = replace(described, errors=errors)
        self._opinions = pool.opinions
        self._answers = answers_seen(described.standardised(pool.normaliser), pool, cfg)

    def rows(self, of: frozenset[str]) -> list[int]:
        """Answers of some raters in the order they came, `_ENOUGH` of each."""
        found = [row for name in sorted(of) for row in spread(self.all_of(name))]
        return sorted(found, key=self._place.__getitem__)

    def all_of(self, name: str) -> list[int]:
        """Answers of a rater in the order they came."""
        return [row for row in self._place if self.raters[row] == name]

    def posterior(self, rows: Sequence[int], *, tires_after: int = 0) -> Posterior:
        """What these answers leave of the wishes.

        Args:
            rows: The answers.
            tires_after: Of so many of one rater; the later may err more or less often.
        """
        part = self._answers.part(torch.tensor(rows))
        names = sorted({self.raters[row] for row in rows})
        rater = torch.tensor([names.index(self.raters[row]) for row in rows])
        if tires_after:
            rater[tires_after:] += 1
        part = replace(part, errors=replace(part.errors, rater=rater))
        generator = torch.Generator().manual_seed(self._seed)
        careless = self._cfg.reliability.careless
        return sampled(self._opinions, careless, part, _PARTICLES, generator)


def spread(rows: Sequence[int], most: int = _ENOUGH) -> list[int]:
    """All of them, or `most` spread evenly over them."""
    count = min(len(rows), most)
    return [rows[place * len(rows) // count] for place in range(count)]


def _described(told: _Told, group: frozenset[str]) -> Group:
    rows = told.rows(group)
    return Group(
        raters=tuple(sorted(group)),
        answers=sum(rater in group for rater in told.raters),
        wanted=_wanted(told.posterior(rows)),
    )


def _wanted(posterior: Posterior) -> tuple[Wanted, ...]:
    found = posterior.found
    on = found.weight > 0
    habit, way = habit_of(found.opinion), _WAYS[found.opinion % len(SHAPES)]
    shares = []
    for index, name in enumerate(HABITS):
        own = on & (habit == index)
        share = float(own.any(dim=1).float().mean())
        if share >= _NAMED:
            how = _HOW[int(way[own].bincount(minlength=len(_HOW)).argmax())]
            shares.append(Wanted(habit=name, how=how, probability=share))
    return tuple(sorted(shares, key=lambda each: -each.probability))


def _ways() -> Tensor:
    """[S] index in `_HOW` of every shape."""
    rises = SHAPES.diff(dim=1)
    return torch.where(
        (rises >= 0).all(dim=1), 0, torch.where((rises <= 0).all(dim=1), 1, 2)
    )


_HOW = ("more", "less", "a certain")
_WAYS = _ways()


def _change_of(told: _Told, rater: str) -> Changed | None:
    """The change of a rater, at a quarter, half or three quarters of the answers.

    Who only errs more often, or less, still wants the same.
    """
    own = told.all_of(rater)
    if not told.timed or len(own) < 2 * _LEAST_TO_CHANGE:
        return None
    rows = spread(own, 2 * _ENOUGH)
    together = told.posterior(rows).log_evidence
    best = None
    for quarter in (1, 2, 3):
        at = quarter * len(rows) // 4
        after = own.index(rows[at])
        if min(after, len(own) - after) < _LEAST_TO_CHANGE:
            continue
        apart = [told.posterior(part).log_evidence for part in (rows[:at], rows[at:])]
        one = max(together, told.posterior(rows, tires_after=at).log_evidence)
        log_odds = sum(apart) - one - _ODDS_ALIKE
        if log_odds > 0 and (best is None or log_odds > best.log_odds):
            best = Changed(rater=rater, after=after, log_odds=log_odds)
    return best
