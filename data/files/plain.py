"""Frozen dataclasses to plain values and back, for JSON, YAML and checkpoints."""

from __future__ import annotations

import types
from collections.abc import Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from typing import (
    Any,
    Literal,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

T = TypeVar("T")

ADDED_LATER = {"added_later": True}
"""Metadata of a field that older files lack: its default is not written, so that what
does not use it is the same file to the last byte, name and hash."""

NONE_AS_BEFORE = {"added_later": True, "none_as_before": True}
"""Metadata of a field added later whose None is what was there before it: it is not
written where all is written either, so that an older run is the same run."""

KIND_NONE = {"kind_none": True}
"""Metadata of a field whose None was settings of the kind `none` in older files."""
ONE_OF = {"one_of": True}
"""Metadata of a field that holds one of several records: the `CLASS` of which it is
is written."""
CLASS = "class"
"""Names the class of such a record, which its fields alone may not tell."""


_IN_WORDS = {
    int: "a whole number",
    float: "a number",
    str: "a text",
    bool: "true or false",
}


def to_plain(record: Any, *, whole: bool = False) -> dict[str, Any]:
    """Dictionaries, lists, strings, numbers, booleans and None only.

    Args:
        record: The dataclass.
        whole: Write fields that were added later too where they have their default: a
            default may change, and what is written is what was in force.
    """
    return {
        field.name: _classed(field, getattr(record, field.name), whole)
        for field in fields(record)
        if not _left_out(field, getattr(record, field.name), whole)
    }


def _classed(field: Field[Any], value: Any, whole: bool) -> Any:
    plain = _plain(value, whole)
    if "one_of" in field.metadata and is_dataclass(value):
        return {CLASS: type(value).__name__, **plain}
    return plain


def _left_out(field: Field[Any], value: Any, whole: bool) -> bool:
    if "none_as_before" in field.metadata and value is None:
        return True
    if whole or "added_later" not in field.metadata:
        return False
    if field.default_factory is not MISSING:
        return value == field.default_factory()
    return value == field.default


def from_plain(cls: type[T], values: Mapping[str, Any]) -> T:
    """Build the dataclass `cls` from what `to_plain` gave; its checks run again.

    What a class attribute `REMOVED` names may be in older files, and is left out; a
    static method `of_older` says what became of what they call otherwise.

    Raises:
        ValueError: a field is missing, unknown or of the wrong shape.
    """
    hints = get_type_hints(cls)
    known = {field.name: field for field in fields(cls)}  # type: ignore[arg-type]
    removed = getattr(cls, "REMOVED", ())
    of_older = getattr(cls, "of_older", dict)
    values = {
        name: None if _is_none(known.get(name), value) else value
        for name, value in of_older(values).items()
        if name not in removed
    }
    unknown = sorted(values.keys() - known.keys())
    if unknown:
        raise ValueError(f"{cls.__name__} has no field {', '.join(unknown)}")
    try:
        return cls(**{name: _typed(hints[name], v, name) for name, v in values.items()})
    except TypeError as error:
        raise ValueError(f"{cls.__name__}: {error}") from None


def _is_none(field: Field[Any] | None, value: Any) -> bool:
    """Whether an older file says in `value` that `field` is None."""
    was_kind = field is not None and "kind_none" in field.metadata
    return was_kind and isinstance(value, Mapping) and value.get("kind") == "none"


def _plain(value: Any, whole: bool) -> Any:
    if is_dataclass(value):
        return to_plain(value, whole=whole)
    if isinstance(value, Mapping):
        return {str(key): _plain(entry, whole) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry, whole) for entry in value]
    return value if isinstance(value, bool | int | float | None) else str(value)


def _typed(hint: Any, value: Any, name: str) -> Any:
    """`value` as what `hint` asks for.

    Raises:
        ValueError: it is something else.
    """
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return _first_that_fits(arguments, value, name)
    if origin is Literal:
        if value in arguments:
            return value
        allowed = ", ".join(map(str, arguments))
        raise ValueError(f"{name} must be one of {allowed}; got {value!r}")
    if is_dataclass(hint) and isinstance(hint, type):
        if not isinstance(value, Mapping):
            raise ValueError(f"{name} must hold settings, got {value!r}")
        return from_plain(hint, value)
    if origin is tuple:
        return _tuple(arguments, value, name)
    if isinstance(hint, type) and hint in _IN_WORDS:
        return _simple(hint, value, name)
    if isinstance(hint, type) and not isinstance(value, hint):
        return hint(value)
    return value


def _first_that_fits(options: tuple[Any, ...], value: Any, name: str) -> Any:
    if value is None and type(None) in options:
        return None
    if isinstance(value, Mapping) and CLASS in value:
        return _of_class(options, value, name)
    reasons = []
    for option in options:
        if option is not type(None):
            try:
                return _typed(option, value, name)
            except ValueError as error:
                reasons.append(str(error))
    raise ValueError("; or ".join(reasons))


def _of_class(options: tuple[Any, ...], value: Mapping[str, Any], name: str) -> Any:
    classes = {
        option.__name__: option
        for option in options
        if isinstance(option, type) and is_dataclass(option)
    }
    if value[CLASS] not in classes:
        allowed = ", ".join(classes)
        raise ValueError(f"{name} must be one of {allowed}; got {value[CLASS]!r}")
    rest = {key: entry for key, entry in value.items() if key != CLASS}
    return _typed(classes[value[CLASS]], rest, name)


def _tuple(entries: tuple[Any, ...], value: Any, name: str) -> tuple[Any, ...]:
    if not isinstance(value, list | tuple):
        raise ValueError(f"{name} must be a list, got {value!r}")
    if len(entries) == 2 and entries[1] is ...:
        return tuple(_typed(entries[0], entry, name) for entry in value)
    if len(value) != len(entries):
        raise ValueError(f"{name} must have {len(entries)} entries, got {len(value)}")
    return tuple(_typed(e, v, name) for e, v in zip(entries, value, strict=True))


def _simple(kind: type, value: Any, name: str) -> Any:
    """`value`, which only a number may change for: 1 is a float, 2.0 an integer."""
    if kind is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if kind is int and isinstance(value, float) and value.is_integer():
        return int(value)
    if isinstance(value, kind) and (kind is bool or not isinstance(value, bool)):
        return value
    raise ValueError(f"{name} must be {_IN_WORDS[kind]}, got {value!r}")
