"""A table in memory: named columns of numbers, each row a moment.

Shapes: N rows, W numbers in a cell.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data.files.limits import LOG_TABLE_BYTES
from gaitpref.formats.logs.log_map import LogError, Names

_PART = re.compile(r"(.+)\[(\d{1,6})(?::(\d{1,6}))?\]")
_MOST = 40
"""Names of columns that an error lists."""
_CHARS = 60


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of one table, or of one episode of it."""

    name: str
    """What errors call it."""
    columns: dict[str, np.ndarray]
    """[N, W] float64, NaN where a cell is empty."""


Reader = Callable[[Path, Collection[str]], list[Table]]
"""Reads the columns of the given names that are there; one table for each episode that
a file keeps apart."""


def named(names: Names) -> tuple[str, ...]:
    """Columns that a map names for one thing."""
    one = isinstance(names, str)
    return ((names,) if names else ()) if one else tuple(names)


def columns_behind(names: Iterable[str]) -> set[str]:
    """Columns to read for `names`, which may be parts as `NAME[0:12]`."""
    found = set(names)
    for name in list(found):
        if part := _PART.fullmatch(name):
            found.add(part[1])
    return found


def picked(table: Table, names: Names, width: int, what: str) -> np.ndarray | None:
    """The numbers [N, width] under `names`; None where the map names none.

    Raises:
        LogError: a column is missing, or they are of another width.
    """
    wanted = named(names)
    if not wanted:
        return None
    found = np.concatenate([_part(table, name, what) for name in wanted], axis=1)
    if found.shape[1] != width:
        raise LogError(
            f"[columns] {what} must be {width} numbers, and {', '.join(wanted)[:200]} "
            f"in {table.name} is {found.shape[1]}; NAME[0:{width}] is a part of "
            "one"
        )
    return found


def _part(table: Table, name: str, what: str) -> np.ndarray:
    if name in table.columns:
        return table.columns[name]
    part = _PART.fullmatch(name)
    if part is None or part[1] not in table.columns:
        raise LogError(
            f"{table.name} has no column {name!r}, which [columns] {what} of the map "
            f"names{told_of(table.columns)}"
        )
    whole = table.columns[part[1]]
    first = int(part[2])
    stop = first + 1 if part[3] is None else int(part[3])
    if not first < stop <= whole.shape[1]:
        raise LogError(
            f"[columns] {what}: {name} is no part of {part[1]}, whose cells hold "
            f"{whole.shape[1]} numbers"
        )
    return whole[:, first:stop]


def told_of(there: Iterable[str]) -> str:
    """The columns there are, for an error."""
    names = sorted(name[:_CHARS] for name in there)
    told = ", ".join(names[:_MOST]) + (", ..." if len(names) > _MOST else "")
    return f"; there are {told or 'none'}"


def require_columns(
    name: str, wanted: Collection[str], there: Collection[str]
) -> list[str]:
    """Those of `wanted` that are `there`, in the order of the latter.

    Raises:
        LogError: none is.
    """
    found = [each for each in there if each in wanted]
    if not found:
        raise LogError(
            f"{name} has none of the columns that the map names "
            f"({', '.join(sorted(wanted))[:300]}){told_of(there)}"
        )
    return found


def require_numbers(name: str, count: int) -> None:
    """Refuse columns of more numbers in all than are read of a log.

    Raises:
        LogError: they are too many.
    """
    if count * 8 > LOG_TABLE_BYTES:
        raise LogError(
            f"{name} holds {count:,} numbers in the columns that are read, the limit "
            f"is {LOG_TABLE_BYTES // 8:,}; cut it into several files"
        )
