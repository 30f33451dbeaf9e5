"""How pairs and answers are spelled as rows of the data base."""

from __future__ import annotations

import gc
import json
import zlib
from collections.abc import Iterable, Sequence
from typing import Any

from data.episodes.clips import Clip
from data.errors import AnswerError

from .answer_records import Answer, Pair, to_json

RATER_COLUMNS = "rater_id, kind, info_json, crc32"
PAIR_COLUMNS = (
    "pair_id, a_rollout, a_start, a_steps, b_rollout, b_start, b_steps, "
    "strategy, round, info_json, crc32"
)
ANSWER_COLUMNS = (
    "answer_id, pair_id, rater_id, choice, p_a, shown_left, shown_ms, watched_ms, "
    "response_ms, confidence, note, reason, supersedes, client_json, created_utc, "
    "role, why, crc32"
)
SELECT_CURRENT = (
    f"SELECT {', '.join('p.' + name for name in PAIR_COLUMNS.split(', '))}, "
    f"{', '.join('c.' + name for name in ANSWER_COLUMNS.split(', '))} "
    "FROM answer_current AS c JOIN pair AS p USING (pair_id)"
)
SELECT_ALL = SELECT_CURRENT.replace("answer_current", "answer")
_COLUMNS = {"rater": RATER_COLUMNS, "pair": PAIR_COLUMNS, "answer": ANSWER_COLUMNS}
_TYPES = {"round": "BIGINT"}
_NUM_PAIR_COLUMNS = len(PAIR_COLUMNS.split(", "))
_ANSWER_FIELDS = ANSWER_COLUMNS.replace("client_json", "client").split(", ")[:-1]
_CLIENT_IDX = _ANSWER_FIELDS.index("client")


def insert_into(table: str) -> str:
    """The statement that adds a row of the values `encode_*` gave."""
    columns = _COLUMNS[table]
    marks = ", ".join(f":{name}" for name in columns.split(", "))
    return f"INSERT INTO {table} ({columns}) VALUES ({marks})"


def either(parameter: str, column: str | None = None) -> str:
    """The condition that a column has the parameter's value, if it has one."""
    # PostgreSQL has to know the type of what may be NULL.
    value = f"CAST(:{parameter} AS {_TYPES.get(parameter, 'TEXT')})"
    return f"({value} IS NULL OR {column or parameter} = {value})"


def _named(columns: str, values: Sequence[Any]) -> dict[str, Any]:
    """The values of a row and their checksum by the names of their columns."""
    row = (*values, row_crc32(*values))
    return dict(zip(columns.split(", "), row, strict=True))


def row_crc32(*values: Any) -> int:
    """Checksum of a row's values; the last column of every table.

    A last value that is empty is left out, so that a column that older rows lack
    leaves their checksums as they are.
    """
    if values[-1] == "":
        values = values[:-1]
    return zlib.crc32("\x1f".join(map(str, values)).encode())


def checked(row: tuple[Any, ...]) -> tuple[Any, ...]:
    """The values of a row without its checksum.

    Raises:
        AnswerError: they are not what was written.
    """
    *values, crc = row
    if row_crc32(*values) != crc:
        raise AnswerError(
            f"the row {str(values[0])[:80]!r} of the answers is not what was written; "
            "`gaitpref data verify` lists the damage, restore the file from a copy"
        )
    return tuple(values)


def encode_rater(rater_id: str, kind: str, info: dict[str, Any]) -> dict[str, Any]:
    """Values for `RATER_COLUMNS`."""
    return _named(RATER_COLUMNS, (rater_id, kind, to_json("info", info)))


def encode_pair(pair: Pair) -> dict[str, Any]:
    """Values for `PAIR_COLUMNS`."""
    a, b = pair.a, pair.b
    clips = (a.rollout, a.start, a.steps, b.rollout, b.start, b.steps)
    info = to_json("info", pair.info)
    values = (pair.pair_id, *clips, pair.strategy, pair.round, info)
    return _named(PAIR_COLUMNS, values)


def decode_pair(row: tuple[Any, ...]) -> Pair:
    """The inverse of `encode_pair`.

    Raises:
        AnswerError: the row is not what was written.
    """
    pair_id, *clips, strategy, round_, info = checked(row)
    a, b = Clip(*clips[:3]), Clip(*clips[3:])
    return Pair(pair_id, a, b, strategy, round_, _object(info))


def _object(text: str) -> dict[str, Any]:
    # Most are empty, and a parser is slow to find that out.
    return {} if text == "{}" else json.loads(text)


def encode_answer(answer: Answer) -> dict[str, Any]:
    """Values for `ANSWER_COLUMNS`."""
    values = [getattr(answer, name) for name in _ANSWER_FIELDS]
    values[_CLIENT_IDX] = to_json("client", answer.client)
    return _named(ANSWER_COLUMNS, values)


def decode_answer(row: tuple[Any, ...]) -> Answer:
    """The inverse of `encode_answer`.

    Raises:
        AnswerError: the row is not what was written.
    """
    values = dict(zip(_ANSWER_FIELDS, checked(row), strict=True))
    values["client"] = _object(values["client"])
    return Answer(**values)


def decode_all(rows: Iterable[tuple[Any, ...]]) -> list[tuple[Pair, Answer]]:
    """Rows of `SELECT_CURRENT`, however many.

    Raises:
        AnswerError: one is not what was written.
    """
    # Nothing made here holds a cycle, and the collector would walk over all of it, and
    # over the whole program, again and again: a tenth of the time.
    collecting = gc.isenabled()
    gc.disable()
    try:
        return [decode_pair_and_answer(row) for row in rows]
    finally:
        if collecting:
            gc.enable()


def decode_pair_and_answer(row: tuple[Any, ...]) -> tuple[Pair, Answer]:
    """A row of `SELECT_CURRENT`."""
    return decode_pair(row[:_NUM_PAIR_COLUMNS]), decode_answer(row[_NUM_PAIR_COLUMNS:])
