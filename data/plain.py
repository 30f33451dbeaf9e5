"""Frozen dataclasses to plain values and back, for JSON, YAML and checkpoints."""

from __future__ import annotations

import types
from collections.abc import Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

T = TypeVar("T")

ADDED_LATER = {"added_later": True}
"""Metadata of a field that older files lack: its default is not written, so that what
does not use it is the same file to the last byte, name and hash."""


def to_plain(record: Any) -> dict[str, Any]:
    """Dictionaries, lists, strings, numbers, booleans and None only."""
    return {
        field.name: _plain(getattr(record, field.name))
        for field in fields(record)
        if not _left_out(field, getattr(record, field.name))
    }


def _left_out(field: Field[Any], value: Any) -> bool:
    if "added_later" not in field.metadata:
        return False
    if field.default_factory is not MISSING:
        return value == field.default_factory()
    return value == field.default


def from_plain(cls: type[T], values: Mapping[str, Any]) -> T:
    """Build the dataclass `cls` from what `to_plain` gave; its checks run again.

    What a class attribute `REMOVED` names may be in older files, and is left out.

    Raises:
        ValueError: a field is missing, unknown or of the wrong shape.
    """
    hints = get_type_hints(cls)
    known = {field.name for field in fields(cls)}  # type: ignore[arg-type]
    removed = getattr(cls, "REMOVED", ())
    values = {name: value for name, value in values.items() if name not in removed}
    unknown = sorted(set(values) - known)
    if unknown:
        raise ValueError(f"{cls.__name__} has no field {', '.join(unknown)}")
    try:
        return cls(**{name: _typed(hints[name], v) for name, v in values.items()})
    except TypeError as error:
        raise ValueError(f"{cls.__name__}: {error}") from None


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        return to_plain(value)
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return value if isinstance(value, bool | int | float | None) else str(value)


def _typed(hint: Any, value: Any) -> Any:
    origin = get_origin(hint)
    if origin in (Union, types.UnionType):
        options = [option for option in get_args(hint) if option is not type(None)]
        return None if value is None else _typed(options[0], value)
    if is_dataclass(hint) and isinstance(hint, type):
        return from_plain(hint, value)
    if origin is tuple:
        entries = get_args(hint)
        if len(entries) == 2 and entries[1] is ...:
            return tuple(_typed(entries[0], entry) for entry in value)
        return tuple(_typed(e, v) for e, v in zip(entries, value, strict=True))
    if hint in (int, float, str, bool):
        return hint(value)
    if isinstance(hint, type) and not isinstance(value, hint):
        return hint(value)
    return value
