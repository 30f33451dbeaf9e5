"""Pairs whose answer is known: what it is, why, and how many people gave it.

Whoever looks gives a known answer. One that many people miss is no good question.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

from data.answers.answer_records import Choice, Pair
from data.answers.curation import known_because

from .rater_figures import Row, Share, gold_share

_NAMES = {"a": "A is better", "b": "B is better", "equal": "equally good"}


@dataclass(frozen=True, kw_only=True)
class KnownAnswer:
    """A pair whose answer is known."""

    pair_id: str
    known: Choice
    because: str
    """Why it is known; empty where nobody said."""
    given: Share
    """Answers of people that were the known one."""
    withdrawn: bool = False
    """Whether it is asked no more."""

    def __str__(self) -> str:
        if self.withdrawn:
            return f"{self.pair_id[:12]}  withdrawn: it is asked no more"
        because = f", as {self.because}" if self.because else ""
        given = f"given by {self.given.hits} of {self.given.of}"
        asked = given if self.given.of else "nobody was asked yet"
        return f"{self.pair_id[:12]}  {_NAMES[self.known]}{because}; {asked}"


def known_answers(
    pairs: Iterable[Pair], rows: Sequence[Row], withdrawn: Collection[str] = ()
) -> list[KnownAnswer]:
    """The pairs whose answer is known, in the order they came.

    Args:
        pairs: All pairs.
        rows: Current answers of people.
        withdrawn: Ids of those that were taken back.
    """
    by_pair: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        by_pair[row[0].pair_id].append(row)
    return [
        KnownAnswer(
            pair_id=pair.pair_id,
            known=pair.gold,
            because=known_because(pair),
            given=gold_share(by_pair[pair.pair_id]),
            withdrawn=pair.pair_id in withdrawn,
        )
        for pair in pairs
        if pair.gold is not None
    ]
