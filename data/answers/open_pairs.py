"""Which pairs are open to whom, kept in memory and changed by one answer at a time.

Nothing here looks at all pairs or at all answers again: who asks what comes next, or
how much is left, waits as long with ten pairs as with a million.
"""

from __future__ import annotations

import heapq
from array import array
from bisect import bisect_left, insort
from collections.abc import Iterable, Iterator, Mapping
from itertools import islice
from typing import NamedTuple

from .own_answers import Given, OwnAnswers

_POSITIONS = 2**40
"""More than there are pairs in any store."""
_NOTHING = OwnAnswers()


class PairRow(NamedTuple):
    """What has to be known of a pair."""

    position: int
    """In the store; pairs come in this order."""
    round: int
    """Newer rounds are asked first."""
    room: int
    """People who answer it; 0 where the answer is known."""
    pair_id: str


class OpenPairs:
    """Pairs, and the current answers of people to them.

    A pair is open to a person who has not answered it, as long as fewer people than it
    has room for have answered it or are being shown it.
    """

    def __init__(self) -> None:
        """There are neither pairs nor answers."""
        self._positions = array("q")
        self._rounds = array("q")
        self._rooms = array("q")
        self._people = array("q")
        # Keys, ascending: what is asked first stands last, where a list is cheap.
        self._free: list[int] = []
        self._shared: set[int] = set()
        self._left: dict[str, list[int]] = {}
        self._answers: dict[str, OwnAnswers] = {}
        self._gold: dict[int, str] = {}
        self._withdrawn: set[int] = set()

    @property
    def num_pairs(self) -> int:
        """Pairs without a known answer."""
        return len(self._positions) - len(self._gold)

    def answers_of(self, rater_id: str) -> OwnAnswers:
        """Current answers of a person."""
        return self._answers.get(rater_id, _NOTHING)

    def add_pairs(self, rows: Iterable[PairRow]) -> None:
        """Take in pairs; their positions are larger than all before."""
        for row in rows:
            self._positions.append(row.position)
            self._rounds.append(row.round)
            self._rooms.append(row.room)
            self._people.append(0)
            if row.room:
                self._free.append(_key(row.round, row.position))
            else:
                self._gold[row.position] = row.pair_id
        self._free.sort()

    def withdraw(self, position: int) -> None:
        """Ask no more about a pair whose answer was known."""
        self._withdrawn.add(position)

    def add_answer(self, position: int, rater_id: str, given: Given) -> None:
        """A person has answered a pair, for the first time or again."""
        own = self._answers.setdefault(rater_id, OwnAnswers())
        if own.add(position, given):
            self._move(given.pair, +1)

    def take_answer(self, position: int, rater_id: str) -> None:
        """An answer of a person is none any more."""
        given = self._answers[rater_id].take(position)
        if given is not None:
            self._move(given.pair, -1)

    def first(
        self, rater_id: str, shown: Mapping[int, int], limit: int | None
    ) -> list[int]:
        """Positions of open pairs, the newest round first and then as they came.

        Args:
            rater_id: To whom they are open.
            shown: How many other people are being shown a pair, by its position.
            limit: Give this many at most; None gives all.
        """
        open_now = (
            position
            for position in self._in_order(rater_id)
            if position not in shown or self._has_room(position, shown[position])
        )
        return list(islice(open_now, limit))

    def count(self, rater_id: str, shown: Mapping[int, int]) -> int:
        """How many positions `first` would give."""
        taken = sum(
            self.is_open(position, rater_id, {})
            and not self._has_room(position, people)
            for position, people in shown.items()
        )
        return len(self._free) + len(self._left_to(rater_id)) - taken

    def is_open(self, position: int, rater_id: str, shown: Mapping[int, int]) -> bool:
        """Whether `first` would give this position, were all asked for."""
        if position in self.answers_of(rater_id):
            return False
        return self._has_room(position, shown.get(position, 0))

    def gold(self, rater_id: str) -> list[str]:
        """Ids of the pairs with a known answer that a person has not answered."""
        return [
            pair_id
            for position, pair_id in self._gold.items()
            if position not in self.answers_of(rater_id)
            and position not in self._withdrawn
        ]

    def repeatable(self, rater_id: str, gap: int, recent: int) -> list[Given]:
        """As of `OwnAnswers.judged_once`, without pairs whose answer is known."""
        found = self.answers_of(rater_id).judged_once(gap, recent)
        return [given for given in found if given.pair not in self._gold]

    def _in_order(self, rater_id: str) -> Iterator[int]:
        left = self._left_to(rater_id)
        keys = heapq.merge(reversed(self._free), reversed(left), reverse=True)
        return (-key % _POSITIONS for key in keys)

    def _left_to(self, rater_id: str) -> list[int]:
        """Keys of the pairs others have answered that have room for this person."""
        if rater_id not in self._left:
            self._left[rater_id] = sorted(
                self._key_of(position)
                for position in self._shared
                if position not in self.answers_of(rater_id)
            )
        return self._left[rater_id]

    def _move(self, position: int, people: int) -> None:
        """One person more, or one less, has answered a pair."""
        index = self._index(position)
        before, room = self._people[index], self._rooms[index]
        self._people[index] = after = before + people
        if not room:
            return
        key = self._key_of(position)
        if before == 0:
            _remove(self._free, key)
        elif after == 0:
            insort(self._free, key)
        if 0 < after < room:
            self._shared.add(position)
        else:
            self._shared.discard(position)
        for name, left in self._left.items():
            wanted = position in self._shared
            if wanted and position not in self.answers_of(name):
                _insert(left, key)
            else:
                _remove(left, key)

    def _has_room(self, position: int, shown: int) -> bool:
        index = self._index(position)
        return self._people[index] + shown < self._rooms[index]

    def _key_of(self, position: int) -> int:
        return _key(self._rounds[self._index(position)], position)

    def _index(self, position: int) -> int:
        return bisect_left(self._positions, position)


def _key(round: int, position: int) -> int:
    """Larger for what is asked earlier."""
    return round * _POSITIONS - position


def _insert(keys: list[int], key: int) -> None:
    at = bisect_left(keys, key)
    if at == len(keys) or keys[at] != key:
        keys.insert(at, key)


def _remove(keys: list[int], key: int) -> None:
    at = bisect_left(keys, key)
    if at < len(keys) and keys[at] == key:
        del keys[at]
