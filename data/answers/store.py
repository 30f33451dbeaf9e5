"""The store of pairs and answers; its records are re-exported from here.

An answer is never changed or deleted: a correction is a new answer that names the old
one. A write that returned is on the disk.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, get_args

from data.errors import AnswerError
from data.files.limits import RATER_ID_CHARS

from .address import Address
from .answer_records import Answer as Answer
from .answer_records import Choice as Choice
from .answer_records import Pair as Pair
from .answer_records import RaterKind as RaterKind
from .backend import Backend, copy_backend, open_backend
from .rows import (
    ANSWER_COLUMNS,
    PAIR_COLUMNS,
    RATER_COLUMNS,
    SELECT_ALL,
    SELECT_CURRENT,
    checked,
    decode_all,
    decode_answer,
    decode_pair,
    decode_pair_and_answer,
    either,
    encode_answer,
    encode_pair,
    encode_rater,
    insert_into,
)
from .typed_text import too_long

_BY_OTHERS = (
    " AND NOT EXISTS (SELECT 1 FROM rater AS r WHERE r.rater_id = s.rater_id "
    "AND r.kind = :kind)"
)
"""The condition that an answer `s` is by a rater of another kind."""


class AnswerStore:
    """Pairs, raters, answers and questions in a SQLite file, or in PostgreSQL.

    One store may be shared by the threads of a process; several processes may have the
    same one open. Every method raises AnswerError if the data base fails.
    """

    def __init__(self, backend: Backend) -> None:
        self._backend = backend

    @property
    def address(self) -> Address:
        """What opens the store again."""
        return self._backend.address

    @property
    def _name(self) -> str:
        return self._backend.name

    @staticmethod
    def open(address: Address) -> AnswerStore:
        """Open the store at `address`, made if it is missing.

        Raises:
            AnswerError: there is something else, or it is of a newer version.
        """
        return AnswerStore(open_backend(address))

    @staticmethod
    def snapshot(address: Address) -> AnswerStore:
        """A copy in memory of the store at `address`, brought up to date.

        Empty if there is no file. It never waits for a writer, and takes a file nobody
        may write. What is added to it is forgotten.

        Raises:
            AnswerError: there is something else, damaged, or of a newer version.
        """
        return AnswerStore(copy_backend(address))

    def close(self) -> None:
        """Close the store; nothing is pending."""
        self._backend.close()

    def __enter__(self) -> AnswerStore:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def add_rater(
        self,
        rater_id: str,
        kind: RaterKind,
        info: dict[str, Any] | None = None,
        *,
        copied: bool = False,
    ) -> None:
        """Make a rater known; one who is known already keeps the first `info`.

        Args:
            copied: From another store, where there may have been no limits yet.

        Raises:
            AnswerError: the id belongs to a rater of another kind, or is too long.
            ValueError: there is no such kind, or `info` is not JSON.
        """
        if kind not in get_args(RaterKind):
            known = ", ".join(get_args(RaterKind))
            raise ValueError(f"a rater is one of {known}, got {kind!r}")
        if not copied and (wrong := too_long(rater_id, RATER_ID_CHARS)):
            raise AnswerError(f"the rater {rater_id[:40]!r}... {wrong}; shorten it")
        row = encode_rater(rater_id, kind, info or {})
        query = f"{insert_into('rater')} ON CONFLICT (rater_id) DO NOTHING"
        with self.transaction():
            self.query(query, row)
            query = "SELECT kind FROM rater WHERE rater_id = :rater"
            found = self.query(query, {"rater": rater_id})[0][0]
            if found != kind:
                raise AnswerError(
                    f"rater {rater_id!r} in {self._name} is {found}, not {kind}; "
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
        query = f"{insert_into('pair')} ON CONFLICT (pair_id) DO NOTHING"
        count = "SELECT count(*) FROM pair"
        with self.transaction():
            before = self.query(count)[0][0]
            self._backend.execute_many(query, rows)
            return self.query(count)[0][0] - before

    def pairs(self, round: int | None = None) -> list[Pair]:
        """All pairs, or those of one round, in the order they were added."""
        rows = self.query(
            f"SELECT {PAIR_COLUMNS} FROM pair "
            f"WHERE {either('round')} ORDER BY position",
            {"round": round},
        )
        return [decode_pair(row) for row in rows]

    def pair(self, pair_id: str) -> Pair:
        """The pair with this id.

        Raises:
            AnswerError: there is none.
        """
        query = f"SELECT {PAIR_COLUMNS} FROM pair WHERE pair_id = :pair"
        rows = self.query(query, {"pair": pair_id})
        if not rows:
            raise AnswerError(f"{self._name} has no pair {pair_id!r}; add it first")
        return decode_pair(rows[0])

    def unanswered(
        self,
        rater_id: str | None = None,
        round: int | None = None,
        *,
        but_by: RaterKind | None = None,
    ) -> list[Pair]:
        """Pairs without an answer by this rater, or by anyone, in insertion order.

        An answer that was taken back is none.

        Args:
            rater_id: Who has not answered them.
            round: Only pairs of this round.
            but_by: Answers of raters of this kind are none either.
        """
        values: dict[str, Any] = {"rater": rater_id, "round": round}
        others = ""
        if but_by is not None:
            values["kind"] = but_by
            others = _BY_OTHERS
        rows = self.query(
            f"SELECT {PAIR_COLUMNS} FROM pair AS p "
            f"WHERE {either('round')} AND NOT EXISTS ("
            "SELECT 1 FROM answer_current AS s WHERE s.pair_id = p.pair_id "
            f"AND {either('rater', 's.rater_id')}{others}) ORDER BY position",
            values,
        )
        return [decode_pair(row) for row in rows]

    def add_answer(self, answer: Answer, *, copied: bool = False) -> bool:
        """Record an answer.

        Args:
            copied: From another store, where there may have been no limits yet.

        Returns:
            False if the same answer is there already, as after a retry.

        Raises:
            AnswerError: its id is taken by another answer, its pair or rater is not
                known, what it corrects is not a current answer of the same rater to
                the same pair, or a text is too long.
        """
        if not copied:
            _require_short(answer)
        with self.transaction():
            known = self.find_answer(answer.answer_id)
            if known is not None:
                if known == answer:
                    return False
                raise AnswerError(
                    f"answer {answer.answer_id!r} is in {self._name} with another "
                    "content; give a new answer a new id, and correct with supersedes"
                )
            self._require_known("pair", "pair_id", answer.pair_id)
            self._require_known("rater", "rater_id", answer.rater_id)
            self._require_correctable(answer)
            self.query(insert_into("answer"), encode_answer(answer))
            return True

    def find_answer(self, answer_id: str) -> Answer | None:
        """The answer with this id, corrected or not."""
        query = f"SELECT {ANSWER_COLUMNS} FROM answer WHERE answer_id = :answer"
        rows = self.query(query, {"answer": answer_id})
        return decode_answer(rows[0]) if rows else None

    def current_answers(self, round: int | None = None) -> list[tuple[Pair, Answer]]:
        """Answers nobody corrected, by pair and then as they came.

        Args:
            round: Only pairs of this round.
        """
        rows = self.query(
            f"{SELECT_CURRENT} WHERE {either('round', 'p.round')} "
            "ORDER BY p.position, c.position",
            {"round": round},
        )
        return decode_all(rows)

    def all_answers(self) -> list[tuple[Pair, Answer]]:
        """Every answer as it came, those corrected later included."""
        rows = self.query(f"{SELECT_ALL} ORDER BY c.position")
        return decode_all(rows)

    def current_answer(self, answer_id: str) -> tuple[Pair, Answer] | None:
        """The answer with this id; None if there is none, or it was corrected."""
        query = f"{SELECT_CURRENT} WHERE c.answer_id = :answer"
        rows = self.query(query, {"answer": answer_id})
        return decode_pair_and_answer(rows[0]) if rows else None

    def history(self, rater_id: str, limit: int = 20) -> list[tuple[Pair, Answer]]:
        """The last current answers of a rater, newest first."""
        rows = self.query(
            f"{SELECT_CURRENT} WHERE c.rater_id = :rater "
            "ORDER BY c.position DESC LIMIT :limit",
            {"rater": rater_id, "limit": limit},
        )
        return decode_all(rows)

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
            f"WHERE {either('rater', 'rater_id')} AND {either('round')} "
            f"AND {either('choice')}",
            {"rater": rater_id, "round": round, "choice": choice},
        )
        return int(rows[0][0])

    def query(self, query: str, values: Mapping[str, Any] | None = None) -> list[Any]:
        """The rows of one statement; for the tables kept by other modules."""
        return self._backend.execute(query, values or {})

    @property
    def in_transaction(self) -> bool:
        """Whether this thread is inside `transaction`."""
        return self._backend.in_transaction

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """All of the block is on the disk when it ends, or nothing of it ever is.

        No other process or thread writes meanwhile. Inside another transaction it is a
        part of that one.
        """
        with self._backend.transaction():
            yield

    @contextmanager
    def together(self) -> Iterator[None]:
        """The transactions of the block are on the disk when it ends, not before.

        For many small ones: the disk is waited for once. Each is whole by itself, and
        one that fails takes none of the others along. No other thread writes meanwhile.
        """
        with self._backend.together():
            yield

    def _require_known(self, table: str, column: str, value: str) -> None:
        query = f"SELECT 1 FROM {table} WHERE {column} = :value"
        if not self.query(query, {"value": value}):
            raise AnswerError(f"{self._name} has no {table} {value!r}; add it first")

    def _require_correctable(self, answer: Answer) -> None:
        if answer.supersedes is None:
            return
        query = "SELECT pair_id, rater_id FROM answer_current WHERE answer_id = :answer"
        found = self.query(query, {"answer": answer.supersedes})
        if not found:
            raise AnswerError(
                f"{self._name} has no current answer {answer.supersedes!r}: it was "
                "never given, or corrected already; reload and correct the newest one"
            )
        if found[0] != (answer.pair_id, answer.rater_id):
            raise AnswerError(
                f"answer {answer.supersedes!r} is by another rater or about another "
                "pair; correct only your own answer to the same pair"
            )


def _require_short(answer: Answer) -> None:
    for name in ("note", "reason"):
        if wrong := too_long(getattr(answer, name)):
            raise AnswerError(
                f"the {name} of answer {answer.answer_id!r} {wrong}; shorten it"
            )
