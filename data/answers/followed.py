"""Follows what is added to a store of answers: of its log, only new rows are read.

Other processes add rows as well. Rows are never changed, and come in the order of their
positions, because one transaction at a time writes.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

from .answer_records import Choice, RaterKind, Role, Side
from .curation import OWNER
from .open_pairs import OpenPairs, PairRow
from .overlap import Overlap
from .own_answers import Given
from .store import AnswerStore

_AT_ONCE = 20_000
"""Positions that are read in one statement."""
_NEWEST = """
SELECT (SELECT max(position) FROM answer), (SELECT max(position) FROM pair)
"""
# Both ends are given: with one, a server that has not counted its rows yet expects a
# third of them, and looks at all. Its `json_extract` is slow, and seldom needed.
_PAIRS = """
SELECT position, pair_id, round, CASE WHEN info_json LIKE '%gold%'
  THEN json_extract(info_json, '$.gold') IS NOT NULL ELSE FALSE END
FROM pair WHERE position BETWEEN :first AND :last ORDER BY position
"""
_ANSWERS = """
SELECT a.position, a.answer_id, r.kind, a.rater_id, a.role, p.position, a.pair_id,
  a.shown_left, a.choice, old.position, old.role
FROM answer AS a JOIN pair AS p USING (pair_id) JOIN rater AS r USING (rater_id)
  LEFT JOIN answer AS old ON old.answer_id = a.supersedes
WHERE a.position BETWEEN :first AND :last ORDER BY a.position
"""
_Table = Literal["answer", "pair"]


class Followed:
    """The open pairs of a store; for one thread at a time."""

    def __init__(self, store: AnswerStore, overlap: Overlap) -> None:
        """Nothing is read yet."""
        self._store, self._overlap = store, overlap
        self._begin()

    def open_pairs(self) -> OpenPairs:
        """The open pairs as of now; inside a transaction, with what that has added.

        Raises:
            AnswerError: the data base fails.
        """
        if not all(self._are_there(*rows) for rows in self._unsure.items()):
            self._begin()
        lasts = not self._store.in_transaction
        if lasts:
            self._unsure.clear()
        answers, pairs = (last or 0 for last in self._store.query(_NEWEST)[0])
        try:
            self._read(answers, pairs, lasts)
        except BaseException:
            self._begin()
            raise
        return self._open

    def _begin(self) -> None:
        self._open = OpenPairs()
        self._pairs = self._answers = 0
        # Positions and ids that were read in a transaction: it may be undone yet.
        self._unsure: dict[_Table, list[tuple[int, str]]] = {}

    def _are_there(self, table: _Table, rows: list[tuple[int, str]]) -> bool:
        query = (
            f"SELECT position, {table}_id FROM {table} "
            "WHERE position BETWEEN :first AND :last ORDER BY position"
        )
        values = {"first": rows[0][0], "last": rows[-1][0]}
        return self._store.query(query, values) == rows

    def _read(self, answers: int, pairs: int, lasts: bool) -> None:
        """Take in what is new up to these positions, pairs before their answers."""
        for rows in self._new(_PAIRS, self._pairs, pairs):
            self._open.add_pairs(
                PairRow(position, round, 0 if gold else self._room(pair_id), pair_id)
                for position, pair_id, round, gold in rows
            )
            if not lasts:
                self._note("pair", rows)
        for rows in self._new(_ANSWERS, self._answers, answers):
            for row in rows:
                self._take(*row)
            if not lasts:
                self._note("answer", rows)
        self._pairs, self._answers = pairs, answers

    def _take(
        self,
        position: int,
        answer_id: str,
        kind: RaterKind,
        rater_id: str,
        role: Role,
        pair: int,
        pair_id: str,
        shown_left: Side,
        choice: Choice,
        old_position: int | None,
        old_role: Role | None,
    ) -> None:
        if (kind, rater_id) == ("scripted", OWNER):
            self._open.withdraw(pair)
        if kind != "human":
            return
        if old_position is not None and old_role != "undo":
            self._open.take_answer(old_position, rater_id)
        if role != "undo":
            judged = role == "first" and choice in ("a", "b", "equal")
            given = Given(pair, pair_id, shown_left, role == "repeat", judged)
            self._open.add_answer(position, rater_id, given)

    def _note(self, table: _Table, rows: list[Any]) -> None:
        if rows:
            self._unsure.setdefault(table, []).extend(row[:2] for row in rows)

    def _new(self, query: str, seen: int, last: int) -> Iterator[list[Any]]:
        for first in range(seen + 1, last + 1, _AT_ONCE):
            end = min(first + _AT_ONCE - 1, last)
            yield self._store.query(query, {"first": first, "last": end})

    def _room(self, pair_id: str) -> int:
        return self._overlap.raters if self._overlap.takes(pair_id) else 1
