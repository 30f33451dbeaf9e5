"""Whether what somebody else wrote down as a rater, a pair or an answer can be one."""

from __future__ import annotations

import math
import types
from collections.abc import Iterable, Mapping
from dataclasses import asdict, fields
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from data.episodes.clips import Clip
from data.errors import AnswerError
from data.files.limits import BIGGEST_INTEGER

from .answer_records import Answer, Pair, RaterKind, to_json, utc_text

Rater = tuple[str, RaterKind, dict[str, Any]]
"""Id, kind and info."""


def rater_of(values: Mapping[str, Any]) -> Rater:
    """A rater.

    Raises:
        ValueError, TypeError, KeyError: a field is missing, unknown or of another kind.
    """
    wanted = {"rater_id": str, "kind": RaterKind, "info": dict}
    _require_fields(values, wanted)
    if not values["rater_id"]:
        raise ValueError("rater_id must not be empty")
    return values["rater_id"], values["kind"], values["info"]


def pair_of(values: Mapping[str, Any]) -> Pair:
    """A pair whose id is that of its clips.

    Raises:
        ValueError, TypeError, KeyError: as for `rater_of`.
    """
    _require_fields(values, _hints(Pair) | {"a": dict, "b": dict})
    for side in ("a", "b"):
        _require_fields(values[side], _hints(Clip))
    a, b = Clip(**values["a"]), Clip(**values["b"])
    pair = Pair(**{**values, "a": a, "b": b})
    if pair.pair_id != Pair.make(a, b, strategy="", round=0).pair_id:
        raise ValueError("its id is not that of its clips")
    return pair


def answer_of(values: Mapping[str, Any]) -> Answer:
    """An answer.

    Raises:
        ValueError, TypeError, KeyError, OverflowError: as for `rater_of`.
    """
    # Answers of before it could be said.
    values = {"why": "", **values}
    _require_fields(values, _hints(Answer))
    # Turns the time into that of Greenwich, which not every time has.
    utc_text(values["created_utc"])
    return Answer(**values)


def require_sound(
    name: str,
    raters: Iterable[Rater],
    pairs: Iterable[Pair],
    answers: Iterable[Answer],
) -> None:
    """Look at every field of what a data base of somebody else gave.

    Args:
        name: What errors call the data base.
        raters, pairs, answers: What it gave; its checksums anybody can compute.

    Raises:
        AnswerError: a field is of another kind than it can be.
    """
    try:
        for rater_id, kind, info in raters:
            rater_of({"rater_id": rater_id, "kind": kind, "info": info})
        for pair in pairs:
            pair_of(asdict(pair))
        for answer in answers:
            answer_of(asdict(answer))
    except Exception as error:
        raise AnswerError(
            f"the answers of {name} are damaged ({error}); nothing of them was taken, "
            "get them again"
        ) from error


def _hints(cls: type) -> dict[str, Any]:
    hints = get_type_hints(cls)
    return {field.name: hints[field.name] for field in fields(cls)}


def _require_fields(values: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    """Make sure that the fields are those that are wanted, each of its kind.

    Raises:
        ValueError: one is not.
    """
    for name in values.keys() ^ wanted.keys():
        state = "missing" if name in wanted else "unknown"
        raise ValueError(f"the field {str(name)[:40]!r} is {state}")
    for name, value in values.items():
        if not _fits(wanted[name], value):
            raise ValueError(f"{name} cannot be {str(value)[:40]!r}")


def _fits(hint: Any, value: Any) -> bool:
    origin = get_origin(hint) or hint
    if origin in (Union, types.UnionType):
        return any(_fits(option, value) for option in get_args(hint))
    if origin is Literal:
        return isinstance(value, str) and value in get_args(hint)
    if origin is types.NoneType:
        return value is None
    if origin is int:
        return type(value) is int and abs(value) <= BIGGEST_INTEGER
    if origin is float:
        return type(value) in (int, float) and math.isfinite(value)
    if origin is str:
        return isinstance(value, str) and _is_text(value)
    if origin is dict:
        return isinstance(value, dict) and bool(to_json("it", value))
    return isinstance(value, origin)


def _is_text(value: str) -> bool:
    """Half a letter of UTF-16, which JSON can name, is in no text."""
    return not any("\ud800" <= letter <= "\udfff" for letter in value)
