"""How pairs and answers are spelled as rows of the data base."""

from __future__ import annotations

import json
import zlib
from typing import Any

from data.answer_records import Answer, Pair, to_json
from data.clips import Clip
from data.errors import AnswerError

RATER_COLUMNS = "rater_id, kind, info_json, crc32"
PAIR_COLUMNS = (
    "pair_id, a_rollout, a_start, a_steps, b_rollout, b_start, b_steps, "
    "strategy, round, info_json, crc32"
)
ANSWER_COLUMNS = (
    "answer_id, pair_id, rater_id, choice, p_a, shown_left, shown_ms, watched_ms, "
    "response_ms, confidence, note, reason, supersedes, client_json, created_utc, "
    "role, crc32"
)
SELECT_CURRENT = (
    f"SELECT {', '.join('p.' + name for name in PAIR_COLUMNS.split(', '))}, "
    f"{', '.join('c.' + name for name in ANSWER_COLUMNS.split(', '))} "
    "FROM answer_current AS c JOIN pair AS p USING (pair_id)"
)
SELECT_ALL = SELECT_CURRENT.replace("answer_current", "answer")
_NUM_PAIR_COLUMNS = len(PAIR_COLUMNS.split(", "))
_ANSWER_FIELDS = ANSWER_COLUMNS.replace("client_json", "client").split(", ")[:-1]
_CLIENT_IDX = _ANSWER_FIELDS.index("client")


def row_crc32(*values: Any) -> int:
    """Checksum of a row's values; the last column of every table."""
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


def encode_rater(rater_id: str, kind: str, info: dict[str, Any]) -> tuple[Any, ...]:
    """Values for `RATER_COLUMNS`."""
    values = (rater_id, kind, to_json("info", info))
    return (*values, row_crc32(*values))


def encode_pair(pair: Pair) -> tuple[Any, ...]:
    """Values for `PAIR_COLUMNS`."""
    a, b = pair.a, pair.b
    clips = (a.rollout, a.start, a.steps, b.rollout, b.start, b.steps)
    info = to_json("info", pair.info)
    values = (pair.pair_id, *clips, pair.strategy, pair.round, info)
    return (*values, row_crc32(*values))


def decode_pair(row: tuple[Any, ...]) -> Pair:
    """The inverse of `encode_pair`.

    Raises:
        AnswerError: the row is not what was written.
    """
    pair_id, *clips, strategy, round_, info = checked(row)
    a, b = Clip(*clips[:3]), Clip(*clips[3:])
    return Pair(pair_id, a, b, strategy, round_, json.loads(info))


def encode_answer(answer: Answer) -> tuple[Any, ...]:
    """Values for `ANSWER_COLUMNS`."""
    values = [getattr(answer, name) for name in _ANSWER_FIELDS]
    values[_CLIENT_IDX] = to_json("client", answer.client)
    return (*values, row_crc32(*values))


def decode_answer(row: tuple[Any, ...]) -> Answer:
    """The inverse of `encode_answer`.

    Raises:
        AnswerError: the row is not what was written.
    """
    values = dict(zip(_ANSWER_FIELDS, checked(row), strict=True))
    return Answer(**values | {"client": json.loads(values["client"])})


def decode_pair_and_answer(row: tuple[Any, ...]) -> tuple[Pair, Answer]:
    """A row of `SELECT_CURRENT`."""
    return decode_pair(row[:_NUM_PAIR_COLUMNS]), decode_answer(row[_NUM_PAIR_COLUMNS:])
