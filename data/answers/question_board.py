"""What raters are being shown: the part of their queue that must survive a restart.

A rater's questions are a pile; the last one is on the screen. While its lease lasts,
the pair of a first question is kept from other raters.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .answer_records import Answer, Pair, Role, Side, utc_text
from .followed import Followed
from .overlap import Overlap
from .rows import PAIR_COLUMNS, SELECT_ALL, decode_all, decode_pair
from .store import AnswerStore

_COLUMNS = (
    "question_id, rater_id, pair_id, role, shown_left, supersedes, shown_utc, "
    "expires_utc"
)
_AT_ONCE = 500
"""Rows that are asked for by their positions in one statement."""
_RECENT = 400
"""Answers among which one to ask again is looked for."""
_LOOKED_AT = """
SELECT p.position, count(DISTINCT q.rater_id)
FROM question AS q JOIN pair AS p USING (pair_id)
WHERE q.rater_id <> :rater AND q.role = 'first' AND q.supersedes IS NULL
  AND q.expires_utc > :now
GROUP BY p.position
"""


@dataclass(frozen=True, kw_only=True)
class Shown:
    """A question somebody is being shown."""

    question_id: str
    """Becomes the id of the answer, so that a question has one answer at most."""
    rater_id: str
    pair_id: str
    role: Role
    shown_left: Side
    supersedes: str | None
    """The answer that was reopened."""
    shown_utc: str
    """When it was first shown; ISO 8601 with an offset."""
    expires_utc: str
    """Until when the pair is kept from others; ISO 8601 with an offset."""


@dataclass(frozen=True, kw_only=True)
class Tally:
    """How far a person is."""

    answered: int
    """Current answers of the person."""
    open: int
    """Pairs still to be answered by this person, shown ones included."""
    total: int
    """Pairs in the data set, without those with a known answer."""


class QuestionBoard:
    """The questions on the screens of all people, in the data base of the answers.

    What is open is kept in memory and follows the data base, so that one board serves
    all raters of a process; one thread at a time. Every method raises AnswerError if
    the data base fails, or names an unknown rater, pair or answer.
    """

    def __init__(self, store: AnswerStore, overlap: Overlap) -> None:
        self._store = store
        self._followed = Followed(store, overlap)

    def follow(self) -> None:
        """Take in what there is, so that whoever asks first need not wait for it."""
        self._followed.open_pairs()

    def shown(self, rater_id: str) -> list[Shown]:
        """The rater's questions, the one on the screen last."""
        rows = self._store.query(
            f"SELECT {_COLUMNS} FROM question WHERE rater_id = :rater "
            "ORDER BY position",
            {"rater": rater_id},
        )
        names = _COLUMNS.split(", ")
        return [Shown(**dict(zip(names, row, strict=True))) for row in rows]

    def show(self, question: Shown) -> None:
        """Put a question on top of the rater's pile."""
        names = _COLUMNS.split(", ")
        values = {name: getattr(question, name) for name in names}
        for name in ("shown_utc", "expires_utc"):
            values[name] = utc_text(values[name])
        marks = ", ".join(f":{name}" for name in names)
        with self._store.transaction():
            self._store.query(
                f"INSERT INTO question ({_COLUMNS}) VALUES ({marks})", values
            )

    def renew(self, rater_id: str, expires_utc: str) -> None:
        """Keep all of the rater's pairs until `expires_utc`."""
        with self._store.transaction():
            self._store.query(
                "UPDATE question SET expires_utc = :expires WHERE rater_id = :rater",
                {"expires": utc_text(expires_utc), "rater": rater_id},
            )

    def close(self, question_id: str) -> None:
        """Take a question off its pile, if it is on one."""
        with self._store.transaction():
            self._store.query(
                "DELETE FROM question WHERE question_id = :question",
                {"question": question_id},
            )

    def open_pairs(
        self, rater_id: str, now_utc: str, *, limit: int | None = None
    ) -> list[Pair]:
        """Pairs this person may be asked, the newest round first, in the loop's order.

        Not those answered by the person, nor those that enough people answered or are
        looking at. Answers of scripted raters and models do not count.

        Args:
            rater_id: Who is asked.
            now_utc: When; ISO 8601 with an offset.
            limit: Give this many at most.
        """
        looked_at = self._looked_at(rater_id, now_utc)
        found = self._followed.open_pairs().first(rater_id, looked_at, limit)
        rows = self._at(f"SELECT position, {PAIR_COLUMNS} FROM pair", "position", found)
        pairs = {row[0]: decode_pair(row[1:]) for row in rows}
        return [pairs[position] for position in found]

    def is_open(self, pair_id: str, rater_id: str, now_utc: str) -> bool:
        """Whether `open_pairs` would give this pair."""
        query = "SELECT position FROM pair WHERE pair_id = :pair"
        looked_at = self._looked_at(rater_id, now_utc)
        found = self._followed.open_pairs()
        return any(
            found.is_open(position, rater_id, looked_at)
            for (position,) in self._store.query(query, {"pair": pair_id})
        )

    def tally(self, rater_id: str, now_utc: str) -> Tally:
        """How far this person is."""
        looked_at = self._looked_at(rater_id, now_utc)
        found = self._followed.open_pairs()
        return Tally(
            answered=len(found.answers_of(rater_id)),
            open=found.count(rater_id, looked_at),
            total=found.num_pairs,
        )

    def count_answers(self, rater_id: str) -> int:
        """How many current answers of this person there are."""
        return len(self._followed.open_pairs().answers_of(rater_id))

    def gold_pairs(self, rater_id: str) -> list[str]:
        """Ids of pairs with a known answer that this person has not answered."""
        return self._followed.open_pairs().gold(rater_id)

    def repeatable(self, rater_id: str, gap: int) -> list[tuple[str, Side]]:
        """Pairs that the rater can be asked again, and the side of clip a back then.

        Those judged when asked first, and not asked again yet, the newest first.

        Args:
            gap: Leave out the newest answers, this many.
        """
        found = self._followed.open_pairs().repeatable(rater_id, gap, _RECENT)
        return [(given.pair_id, given.shown_left) for given in found]

    def history(self, rater_id: str, limit: int = 20) -> list[tuple[Pair, Answer]]:
        """The last current answers of a person, newest first."""
        found = self._followed.open_pairs().answers_of(rater_id).newest(limit)
        return decode_all(self._at(SELECT_ALL, "c.position", found))[::-1]

    def undone(self, rater_id: str, pair_id: str) -> list[Answer]:
        """What a person said about a pair and took back, the newest first."""
        rows = self._store.query(
            "SELECT supersedes FROM answer WHERE pair_id = :pair "
            "AND rater_id = :rater AND role = 'undo' ORDER BY position DESC",
            {"pair": pair_id, "rater": rater_id},
        )
        found = (self._store.find_answer(answer_id) for (answer_id,) in rows)
        return [answer for answer in found if answer is not None]

    def _at(self, query: str, column: str, positions: list[int]) -> list[Any]:
        """The rows of `query` at these positions, in ascending order."""
        rows, ordered = [], sorted(positions)
        for first in range(0, len(ordered), _AT_ONCE):
            some = ordered[first : first + _AT_ONCE]
            values = {f"at{index}": position for index, position in enumerate(some)}
            marks = ", ".join(f":{name}" for name in values)
            query_at = f"{query} WHERE {column} IN ({marks}) ORDER BY {column}"
            rows += self._store.query(query_at, values)
        return rows

    def _looked_at(self, rater_id: str, now_utc: str) -> dict[int, int]:
        """How many others are being asked a pair for the first time, by position."""
        values = {"rater": rater_id, "now": utc_text(now_utc)}
        return dict(self._store.query(_LOOKED_AT, values))
