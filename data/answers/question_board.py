"""What raters are being shown: the part of their queue that must survive a restart.

A rater's questions are a pile; the last one is on the screen. While its lease lasts,
the pair of a first question is kept from other raters.
"""

from __future__ import annotations

from dataclasses import dataclass

from .answer_records import Pair, Role, Side, utc_text
from .rows import PAIR_COLUMNS, decode_pair, either
from .store import AnswerStore

_COLUMNS = (
    "question_id, rater_id, pair_id, role, shown_left, supersedes, shown_utc, "
    "expires_utc"
)
_ALL = 2**62
"""A limit that is more than there can be."""
_RECENT = 400
"""Answers among which one to ask again is looked for."""
_OPEN = f"""
FROM pair AS p WHERE {either("pair", "p.pair_id")}
  AND NOT EXISTS (SELECT 1 FROM answer_current AS s
    WHERE s.pair_id = p.pair_id AND s.rater_id = :rater)
  AND (SELECT count(DISTINCT s.rater_id)
    FROM answer_current AS s JOIN rater AS r USING (rater_id)
    WHERE s.pair_id = p.pair_id AND r.kind = 'human')
  + (SELECT count(DISTINCT q.rater_id) FROM question AS q
    WHERE q.pair_id = p.pair_id AND q.rater_id <> :rater AND q.role = 'first'
      AND q.supersedes IS NULL AND q.expires_utc > :now)
  < CASE WHEN p.pair_id < :overlap_below THEN :overlap_raters ELSE 1 END
  AND json_extract(p.info_json, '$.gold') IS NULL
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
class Overlap:
    """Which pairs more than one person answers; equal on all machines."""

    share: float = 0.2
    """Share of the pairs, in [0, 1]."""
    raters: int = 2
    """People who answer each of these pairs."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.share <= 1.0 or self.raters < 1:
            raise ValueError(
                "an overlap needs a share in [0, 1] and at least one rater, got "
                f"{self.share} and {self.raters}"
            )

    @property
    def below(self) -> str:
        """Pairs whose id, a hash, sorts below this text overlap."""
        return f"{round(self.share * 2**32):08x}" if self.share < 1.0 else "g"

    def takes(self, pair_id: str) -> bool:
        """Whether several people answer this pair."""
        return pair_id < self.below


class QuestionBoard:
    """The questions on the screens of all raters, in the file of the answers.

    Every method raises AnswerError if the data base fails, or names an unknown rater,
    pair or answer.
    """

    def __init__(self, store: AnswerStore) -> None:
        self._store = store

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
        self,
        rater_id: str,
        now_utc: str,
        overlap: Overlap,
        *,
        limit: int | None = None,
        pair_id: str | None = None,
    ) -> list[Pair]:
        """Pairs this rater may be asked, the newest round first, in the loop's order.

        Not those answered by the rater, nor those that enough people answered or are
        looking at. Answers of scripted raters and models do not count.

        Args:
            limit: Give this many at most.
            pair_id: Look at this pair only.
        """
        rows = self._store.query(
            f"SELECT {PAIR_COLUMNS} {_OPEN} ORDER BY round DESC, position LIMIT :limit",
            _open_values(rater_id, now_utc, overlap, pair_id)
            | {"limit": _ALL if limit is None else limit},
        )
        return [decode_pair(row) for row in rows]

    def count_open(self, rater_id: str, now_utc: str, overlap: Overlap) -> int:
        """How many pairs `open_pairs` would give."""
        values = _open_values(rater_id, now_utc, overlap, None)
        return int(self._store.query(f"SELECT count(*) {_OPEN}", values)[0][0])

    def count_pairs(self) -> int:
        """How many pairs there are; those with a known answer do not count."""
        return int(
            self._store.query(
                "SELECT count(*) FROM pair "
                "WHERE json_extract(info_json, '$.gold') IS NULL"
            )[0][0]
        )

    def repeatable(self, rater_id: str, gap: int) -> list[tuple[str, Side]]:
        """Pairs that the rater can be asked again, and the side of clip a back then.

        Those judged when asked first, and not asked again yet, the newest first.

        Args:
            gap: Leave out the newest answers, this many.
        """
        # No answer is decoded: a rater of an hour has hundreds, and waits.
        rows = self._store.query(
            """
            SELECT c.pair_id, c.shown_left, c.role = 'first'
              AND c.choice IN ('a', 'b', 'equal')
              AND json_extract(p.info_json, '$.gold') IS NULL
              AND NOT EXISTS (SELECT 1 FROM answer_current AS s
                WHERE s.pair_id = c.pair_id AND s.rater_id = c.rater_id
                AND s.role = 'repeat')
            FROM answer_current AS c JOIN pair AS p USING (pair_id)
            WHERE c.rater_id = :rater ORDER BY c.position DESC LIMIT :limit
            """,
            {"rater": rater_id, "limit": _RECENT},
        )
        return [(pair_id, left) for pair_id, left, fits in rows[max(gap, 0) :] if fits]

    def gold_pairs(self, rater_id: str) -> list[Pair]:
        """Pairs with a known answer that the rater has not answered."""
        rows = self._store.query(
            f"SELECT {PAIR_COLUMNS} FROM pair AS p "
            "WHERE json_extract(info_json, '$.gold') IS NOT NULL AND NOT EXISTS ("
            "SELECT 1 FROM answer_current AS s "
            "WHERE s.pair_id = p.pair_id AND s.rater_id = :rater) ORDER BY position",
            {"rater": rater_id},
        )
        return [decode_pair(row) for row in rows]


def _open_values(
    rater_id: str, now_utc: str, overlap: Overlap, pair_id: str | None
) -> dict[str, str | int | None]:
    return {
        "rater": rater_id,
        "now": utc_text(now_utc),
        "overlap_below": overlap.below,
        "overlap_raters": overlap.raters,
        "pair": pair_id,
    }
