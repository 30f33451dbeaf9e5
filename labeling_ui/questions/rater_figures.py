"""How raters work: speed, habits, and how well they agree with themselves and others.

Pure functions of answers; nothing here keeps anybody from answering.
"""

from __future__ import annotations

import itertools
import statistics
from collections import Counter, defaultdict
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from datetime import datetime

import krippendorff
import numpy as np

from data.answers.answer_records import Answer, Pair
from data.answers.curation import withdrawn
from data.answers.rater_habits import prefers_left
from data.answers.store import AnswerStore

PAUSE_S = 300.0
"""More time than this between two answers is a pause, not work."""
LAST_S, PACES = 3600.0, 8
"""The last hour of work, and into how many parts it is told."""
_QUARTERS, _IN_A_QUARTER = 4, 10
"""Parts in which agreement is told, and what can agree in each, at least: of ten, 16 %
up or down are chance."""
_IN_A_PART = 3
"""Answers of which a median is told, at least."""
FAST_S = 2.0
"""An answer within less is counted as fast."""

Row = tuple[Pair, Answer]


@dataclass(frozen=True)
class Share:
    """A part of a whole, which may be empty."""

    hits: int
    of: int

    @property
    def share(self) -> float | None:
        """In [0, 1]; None of nothing."""
        return self.hits / self.of if self.of else None


@dataclass(frozen=True, kw_only=True)
class RaterFigures:
    """The work of one rater, or of all together."""

    rater_id: str
    answers: int
    per_hour: float | None
    """Answers in an hour of work, pauses left out."""
    median_s: float | None
    """Half of the answers took less, from the first frame on."""
    fast: Share
    """Answers within two seconds."""
    left: Share
    """Preferences for the clip shown left; a half is fair."""
    why: Share
    """Preferences beside which it is said what decided them; nobody has to."""
    self_consistency: Share
    """Own pairs, asked again with the sides swapped, that got the same answer."""
    gold: Share
    """Pairs with a known answer that were answered so."""
    agreement: Share
    """Answers of two people to one pair that prefer the same, or neither."""
    alpha: float | None
    """Krippendorff's alpha, ordinal over five strengths: 1 is perfect, 0 is chance."""
    pace_s: tuple[float, ...] = ()
    """Median time per answer over the last hour of work, in equal parts of it, the
    oldest first: whether a rater gets faster and faster."""

    agreed: tuple[Share, ...] = ()
    """Known answers that were given so and answers that others gave too, in four
    quarters of all answers, the oldest first: whether a rater looks less and less."""


def rater_figures(store: AnswerStore, rater_id: str) -> RaterFigures:
    """The figures of one rater, with the people who answered the same pairs."""
    return figures(human_rows(store), rater_id)


def human_rows(store: AnswerStore) -> list[Row]:
    """The current answers people gave, but to known answers that were withdrawn."""
    people = {name for name, kind in store.raters().items() if kind == "human"}
    gone = withdrawn(store)
    return [
        (pair, answer)
        for pair, answer in store.current_answers()
        if answer.rater_id in people and pair.pair_id not in gone
    ]


def figures(rows: Sequence[Row], rater_id: str) -> RaterFigures:
    """The figures of one rater.

    Args:
        rows: Current answers of everybody.
    """
    own = [row for row in rows if row[1].rater_id == rater_id]
    pairs = {pair.pair_id for pair, _ in own}
    others = [row for row in rows if row[0].pair_id in pairs]
    return _figures(rater_id, own, others, {rater_id})


def all_figures(rows: Sequence[Row]) -> RaterFigures:
    """The figures of all raters together, named `all`."""
    everybody = {answer.rater_id for _, answer in rows}
    return _figures("all", rows, rows, everybody)


def _figures(
    name: str, own: Sequence[Row], shared: Sequence[Row], raters: Collection[str]
) -> RaterFigures:
    answers = [answer for _, answer in own]
    times_s = [time_s for answer in answers if (time_s := _time_s(answer)) is not None]
    sides = [prefers_left(answer) for answer in answers]
    preferences = [
        a for a, side in zip(answers, sides, strict=True) if side is not None
    ]
    return RaterFigures(
        rater_id=name,
        answers=len(answers),
        per_hour=_per_hour(answers),
        median_s=statistics.median(times_s) if times_s else None,
        fast=Share(sum(time_s < FAST_S for time_s in times_s), len(times_s)),
        left=Share(sides.count(True), len(preferences)),
        why=Share(sum(bool(a.why) for a in preferences), len(preferences)),
        self_consistency=_self_consistency(answers),
        gold=gold_share(own),
        agreement=agreement_of(shared, raters),
        alpha=alpha(shared),
        pace_s=_pace_s(answers) if len(raters) == 1 else (),
        agreed=_agreed(own, shared, raters) if len(raters) == 1 else (),
    )


def alpha(rows: Sequence[Row]) -> float | None:
    """Krippendorff's alpha of the preferences, ordinal.

    None where it is undefined: no pair has answers of two raters, or all are equal.
    """
    votes = _votes(rows)
    shared = [by_rater for by_rater in votes.values() if len(by_rater) > 1]
    raters = sorted({rater for by_rater in shared for rater in by_rater})
    domain = sorted({target for by_rater in shared for target in by_rater.values()})
    if len(domain) < 2:
        return None
    # [raters, pairs]; who did not answer a pair is missing there, not wrong.
    table = [[by_rater.get(rater, np.nan) for by_rater in shared] for rater in raters]
    return float(
        krippendorff.alpha(
            reliability_data=table,
            value_domain=domain,
            level_of_measurement="ordinal",
        )
    )


def _votes(rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    """Target of every first preference, by pair and rater."""
    votes: dict[str, dict[str, float]] = defaultdict(dict)
    for pair, answer in rows:
        if answer.target is not None and answer.role == "first":
            votes[pair.pair_id][answer.rater_id] = answer.target
    return votes


def agreement_of(rows: Sequence[Row], raters: Collection[str]) -> Share:
    """Answers of two people to one pair, one of them of `raters`, that say the same."""
    verdicts = [
        _direction(first) == _direction(second)
        for by_rater in _votes(rows).values()
        for (one, first), (two, second) in itertools.combinations(by_rater.items(), 2)
        if one in raters or two in raters
    ]
    return Share(sum(verdicts), len(verdicts))


def _self_consistency(answers: Sequence[Answer]) -> Share:
    by_role: dict[str, dict[tuple[str, str], float]] = {"first": {}, "repeat": {}}
    for answer in answers:
        if answer.target is not None and answer.role in by_role:
            by_role[answer.role][answer.rater_id, answer.pair_id] = answer.target
    first, repeat = by_role["first"], by_role["repeat"]
    both = first.keys() & repeat.keys()
    same = sum(_direction(first[key]) == _direction(repeat[key]) for key in both)
    return Share(same, len(both))


def gold_share(rows: Sequence[Row]) -> Share:
    """How many answers to pairs whose answer is known were that one."""
    asked = [(pair.gold, answer.target) for pair, answer in rows if pair.gold]
    right = sum(
        target is not None and _direction(target) == gold for gold, target in asked
    )
    return Share(right, len(asked))


def _agreed(
    own: Sequence[Row], shared: Sequence[Row], raters: Collection[str]
) -> tuple[Share, ...]:
    """How one rater agrees with known answers and with others, over time."""
    others = [row for row in shared if row[1].rater_id not in raters]
    ordered = sorted(own, key=lambda row: datetime.fromisoformat(row[1].created_utc))
    ends = [len(ordered) * n // _QUARTERS for n in range(_QUARTERS + 1)]
    found = []
    for first, end in itertools.pairwise(ends):
        part = ordered[first:end]
        known, both = gold_share(part), agreement_of([*part, *others], raters)
        found.append(Share(known.hits + both.hits, known.of + both.of))
    return tuple(found) if min(s.of for s in found) >= _IN_A_QUARTER else ()


def _direction(target: float) -> str:
    return "equal" if target == 0.5 else "a" if target > 0.5 else "b"


def _time_s(answer: Answer) -> float | None:
    time_ms = answer.shown_ms if answer.response_ms is None else answer.response_ms
    return None if time_ms is None else time_ms / 1000


def _pace_s(answers: Sequence[Answer]) -> tuple[float, ...]:
    """Median times of answers over the last hour of work of one rater."""
    timed = sorted(
        (datetime.fromisoformat(answer.created_utc), time_s)
        for answer in answers
        if (time_s := _time_s(answer)) is not None
    )
    worked_s, last = 0.0, list[float]()
    for (at, time_s), (later, _) in itertools.pairwise([*timed[::-1], *timed[:1]]):
        last.insert(0, time_s)
        worked_s += min(max((at - later).total_seconds(), 0.0), PAUSE_S)
        if worked_s >= LAST_S:
            break
    parts = min(PACES, len(last) // _IN_A_PART)
    if parts < 2:
        return ()
    return tuple(map(float, map(np.median, np.array_split(np.array(last), parts))))


def _per_hour(answers: Sequence[Answer]) -> float | None:
    """Answers per hour of work; people who work side by side do not share an hour."""
    times: dict[str, list[datetime]] = defaultdict(list)
    for answer in answers:
        times[answer.rater_id].append(datetime.fromisoformat(answer.created_utc))
    gaps_s = [
        (later - earlier).total_seconds()
        for of_rater in times.values()
        for earlier, later in itertools.pairwise(sorted(of_rater))
    ]
    work_s = [gap_s for gap_s in gaps_s if gap_s <= PAUSE_S]
    return len(work_s) / sum(work_s) * 3600 if sum(work_s) > 0 else None


def objections(rows: Sequence[Row]) -> list[tuple[str, int]]:
    """What people had against pairs, in their words, each with how often; the most
    frequent first."""
    said = Counter(answer.reason for _, answer in rows if answer.reason)
    return sorted(said.items(), key=lambda item: (-item[1], item[0]))
