"""The current answers of one person, as far as it has to be known what to ask next."""

from __future__ import annotations

from collections import Counter
from itertools import islice
from typing import NamedTuple

from .answer_records import Side


class Given(NamedTuple):
    """What has to be known of an answer."""

    pair: int
    """Position of its pair."""
    pair_id: str
    shown_left: Side
    repeat: bool
    """The person was asked again."""
    judged: bool
    """It was asked for the first time, and the clips were compared."""


class OwnAnswers:
    """Answers by their positions, which grow."""

    def __init__(self) -> None:
        """Nothing was answered."""
        self._given: dict[int, Given] = {}
        self._times: Counter[int] = Counter()
        self._repeats: Counter[int] = Counter()

    def __len__(self) -> int:
        return len(self._given)

    def __contains__(self, pair: int) -> bool:
        return pair in self._times

    def add(self, position: int, given: Given) -> bool:
        """Take in an answer; whether it is the first to its pair."""
        self._given[position] = given
        self._times[given.pair] += 1
        self._repeats[given.pair] += given.repeat
        return self._times[given.pair] == 1

    def take(self, position: int) -> Given | None:
        """Forget an answer that is none any more; gives it where its pair has no other
        answer."""
        given = self._given.pop(position)
        self._times[given.pair] -= 1
        self._repeats[given.pair] -= given.repeat
        if self._times[given.pair]:
            return None
        del self._times[given.pair], self._repeats[given.pair]
        return given

    def newest(self, limit: int) -> list[int]:
        """Positions of the last answers, newest first."""
        return list(islice(reversed(self._given), limit))

    def judged_once(self, gap: int, recent: int) -> list[Given]:
        """Answers that may be asked for again, newest first.

        Args:
            gap: Leave out the newest, this many.
            recent: Look at the newest, this many.
        """
        return [
            given
            for given in islice(reversed(self._given.values()), max(gap, 0), recent)
            if given.judged and not self._repeats[given.pair]
        ]
