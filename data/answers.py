"""The store of pairs and answers; its records are re-exported from here.

An answer is never changed or deleted: a correction is a new answer that names the old
one. A write that returned is on the disk.
"""

from __future__ import annotations

import json
import sqlite3
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, get_args

from data.answer_database import connect, connect_copy
from data.answer_records import QUESTION as QUESTION
from data.answer_records import Answer as Answer
from data.answer_records import Choice as Choice
from data.answer_records import Pair as Pair
from data.answer_records import RaterKind as RaterKind
from data.answer_records import Role as Role
from data.answer_records import Side as Side
from data.answer_rows import (
    ANSWER_COLUMNS,
    PAIR_COLUMNS,
    RATER_COLUMNS,
    SELECT_ALL,
    SELECT_CURRENT,
    checked,
    decode_answer,
    decode_pair,
    decode_pair_and_answer,
    encode_answer,
    encode_pair,
    encode_rater,
)
from data.errors import AnswerError


class AnswerStore:
    """Pairs, raters, answers and leases in one SQLite file.

    One store may be shared by the threads of a process; several processes may have the
    same file open. Every method raises AnswerError if the data base fails.
    """

    def __init__(self, connection: sqlite3.Connection, path: Path) -> None:
        self.path = path
        self._connection = connection
        self._lock = threading.RLock()

    @staticmethod
    def open(path: Path) -> AnswerStore:
        """Open the store at `path`, made if it is missing.

        Raises:
            AnswerError: the file is something else, or of a newer version.
        """
        return AnswerStore(connect(path), path)

    @staticmethod
    def snapshot(path: Path) -> AnswerStore:
        """A copy in memory of the store at `path`, brought up to date.

        Empty if there is no file. It never waits for a writer, and takes a file nobody
        may write. What is added to it is forgotten.

        Raises:
            AnswerError: the file is something else, damaged, or of a newer version.
        """
        return AnswerStore(connect_copy(path), path)

    def close(self) -> None:
        """Close the file; nothing is pending."""
        with self._lock:
            self._connection.close()

    def __enter__(self) -> AnswerStore:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def add_rater(
        self, rater_id: str, kind: RaterKind, info: dict[str, Any] | None = None
    ) -> None:
        """Make a rater known; one who is known already keeps the first `info`.

        Raises:
            AnswerError: the id belongs to a rater of another kind.
            ValueError: there is no such kind, or `info` is not JSON.
        """
        if kind not in get_args(RaterKind):
            known = ", ".join(get_args(RaterKind))
            raise ValueError(f"a rater is one of {known}, got {kind!r}")
        row = encode_rater(rater_id, kind, info or {})
        query = (
            f"INSERT INTO rater ({RATER_COLUMNS}) VALUES (?, ?, ?, ?) "
            "ON CONFLICT (rater_id) DO NOTHING"
        )
        with self.transaction():
            self.query(query, row)
            query = "SELECT kind FROM rater WHERE rater_id = ?"
            found = self.query(query, (rater_id,))[0][0]
            if found != kind:
                raise AnswerError(
                    f"rater {rater_id!r} in {self.path} is {found}, not {kind}; "
                    "choose another rater id"
                )

    def raters(self) -> dict[str, RaterKind]:
        """Everybody who is known, in the order they came."""
        return dict(self.query("SELECT rater_id, kind FROM rater ORDER BY rowid"))

    def rater_rows(self) -> list[tuple[str, RaterKind, dict[str, Any]]]:
        """Id, kind and info of everybody, in the order they came."""
        rows = self.query(f"SELECT {RATER_COLUMNS} FROM rater ORDER BY rowid")
        values = map(checked, rows)
        return [(rater, kind, json.loads(info)) for rater, kind, info in values]

    def add_pairs(self, pairs: Iterable[Pair]) -> int:
        """Add all pairs or none; those known already stay as they are.

        Returns:
            How many were new.
        """
        rows = [encode_pair(pair) for pair in pairs]
        marks = ", ".join("?" * len(PAIR_COLUMNS.split(", ")))
        with self.transaction() as connection:
            before = connection.total_changes
            connection.executemany(
                f"INSERT INTO pair ({PAIR_COLUMNS}) VALUES ({marks}) "
                "ON CONFLICT (pair_id) DO NOTHING",
                rows,
            )
            return connection.total_changes - before

    def pairs(self, round: int | None = None) -> list[Pair]:
        """All pairs, or those of one round, in the order they were added."""
        rows = self.query(
            f"SELECT {PAIR_COLUMNS} FROM pair "
            "WHERE :round IS NULL OR round = :round ORDER BY position",
            {"round": round},
        )
        return [decode_pair(row) for row in rows]

    def pair(self, pair_id: str) -> Pair:
        """The pair with this id.

        Raises:
            AnswerError: there is none.
        """
        query = f"SELECT {PAIR_COLUMNS} FROM pair WHERE pair_id = ?"
        rows = self.query(query, (pair_id,))
        if not rows:
            raise AnswerError(f"{self.path} has no pair {pair_id!r}; add it first")
        return decode_pair(rows[0])

    def unanswered(
        self, rater_id: str | None = None, round: int | None = None
    ) -> list[Pair]:
        """Pairs without an answer by this rater, or by anyone, in insertion order.

        An answer that was taken back is none.
        """
        rows = self.query(
            f"SELECT {PAIR_COLUMNS} FROM pair AS p "
            "WHERE (:round IS NULL OR round = :round) AND NOT EXISTS ("
            "SELECT 1 FROM answer_current AS s WHERE s.pair_id = p.pair_id "
            "AND (:rater IS NULL OR s.rater_id = :rater)) ORDER BY position",
            {"rater": rater_id, "round": round},
        )
        return [decode_pair(row) for row in rows]

    def add_answer(self, answer: Answer) -> bool:
        """Record an answer.

        Returns:
            False if the same answer is there already, as after a retry.

        Raises:
            AnswerError: its id is taken by another answer, its pair or rater is not
                known, or what it corrects is not a current answer of the same rater
                to the same pair.
        """
        with self.transaction():
            known = self.find_answer(answer.answer_id)
            if known is not None:
                if known == answer:
                    return False
                raise AnswerError(
                    f"answer {answer.answer_id!r} is in {self.path} with another "
                    "content; give a new answer a new id, and correct with supersedes"
                )
            self._require_known("pair", "pair_id", answer.pair_id)
            self._require_known("rater", "rater_id", answer.rater_id)
            self._require_correctable(answer)
            marks = ", ".join("?" * len(ANSWER_COLUMNS.split(", ")))
            self.query(
                f"INSERT INTO answer ({ANSWER_COLUMNS}) VALUES ({marks})",
                encode_answer(answer),
            )
            return True

    def find_answer(self, answer_id: str) -> Answer | None:
        """The answer with this id, corrected or not."""
        query = f"SELECT {ANSWER_COLUMNS} FROM answer WHERE answer_id = ?"
        rows = self.query(query, (answer_id,))
        return decode_answer(rows[0]) if rows else None

    def current_answers(self, round: int | None = None) -> list[tuple[Pair, Answer]]:
        """Answers nobody corrected, by pair and then as they came.

        Args:
            round: Only pairs of this round.
        """
        rows = self.query(
            f"{SELECT_CURRENT} WHERE :round IS NULL OR p.round = :round "
            "ORDER BY p.position, c.position",
            {"round": round},
        )
        return [decode_pair_and_answer(row) for row in rows]

    def all_answers(self) -> list[tuple[Pair, Answer]]:
        """Every answer as it came, those corrected later included."""
        rows = self.query(f"{SELECT_ALL} ORDER BY c.position")
        return [decode_pair_and_answer(row) for row in rows]

    def current_answer(self, answer_id: str) -> tuple[Pair, Answer] | None:
        """The answer with this id; None if there is none, or it was corrected."""
        rows = self.query(f"{SELECT_CURRENT} WHERE c.answer_id = ?", (answer_id,))
        return decode_pair_and_answer(rows[0]) if rows else None

    def history(self, rater_id: str, limit: int = 20) -> list[tuple[Pair, Answer]]:
        """The last current answers of a rater, newest first."""
        rows = self.query(
            f"{SELECT_CURRENT} WHERE c.rater_id = ? ORDER BY c.position DESC LIMIT ?",
            (rater_id, limit),
        )
        return [decode_pair_and_answer(row) for row in rows]

    def count(
        self,
        *,
        rater_id: str | None = None,
        round: int | None = None,
        choice: Choice | None = None,
    ) -> int:
        """How many current answers there are."""
        rows = self.query(
            "SELECT count(*) FROM answer_current JOIN pair USING (pair_id) "
            "WHERE (:rater IS NULL OR rater_id = :rater) "
            "AND (:round IS NULL OR round = :round) "
            "AND (:choice IS NULL OR choice = :choice)",
            {"rater": rater_id, "round": round, "choice": choice},
        )
        return int(rows[0][0])

    def query(self, query: str, values: Any = ()) -> list[Any]:
        """The rows of one statement; for the tables kept by other modules."""
        try:
            with self._lock:
                return self._connection.execute(query, values).fetchall()
        except (sqlite3.Error, UnicodeDecodeError) as error:
            raise self._failure(error) from error

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """All of the block is on the disk when it ends, or nothing of it ever is.

        No other process or thread writes meanwhile. Inside another transaction it is a
        part of that one.
        """
        with self._lock:
            if self._connection.in_transaction:
                yield self._connection
                return
            try:
                # Taking the write lock at once cannot fail half-way through.
                self._connection.execute("BEGIN IMMEDIATE")
                try:
                    yield self._connection
                    self._connection.execute("COMMIT")
                except BaseException:
                    if self._connection.in_transaction:
                        self._connection.execute("ROLLBACK")
                    raise
            except (sqlite3.Error, UnicodeDecodeError) as error:
                raise self._failure(error) from error

    def _require_known(self, table: str, column: str, value: str) -> None:
        if not self.query(f"SELECT 1 FROM {table} WHERE {column} = ?", (value,)):
            raise AnswerError(f"{self.path} has no {table} {value!r}; add it first")

    def _require_correctable(self, answer: Answer) -> None:
        if answer.supersedes is None:
            return
        query = "SELECT pair_id, rater_id FROM answer_current WHERE answer_id = ?"
        found = self.query(query, (answer.supersedes,))
        if not found:
            raise AnswerError(
                f"{self.path} has no current answer {answer.supersedes!r}: it was "
                "never given, or corrected already; reload and correct the newest one"
            )
        if found[0] != (answer.pair_id, answer.rater_id):
            raise AnswerError(
                f"answer {answer.supersedes!r} is by another rater or about another "
                "pair; correct only your own answer to the same pair"
            )

    def _failure(self, error: sqlite3.Error | UnicodeDecodeError) -> AnswerError:
        return AnswerError(
            f"{self.path} failed: {error}; nothing of this was stored, try again "
            "when the cause is gone"
        )
