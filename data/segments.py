"""Tables of segments and answers about them, from anywhere: without a robot's rows.

Segments are rows of named numbers: an `.npz` with `rows` [S, T, F] (steps that a
segment lacks are NaN, at its end), `names` [F] and `ids` [S], or a CSV or Parquet table
with a column `segment` and one for every number, a row a step. Answers are a CSV table
with `left`, `right`, `answer` and perhaps `rater`.

Shapes: S segments, T steps of the longest, F columns.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any

import numpy as np

from data.errors import GaitprefError
from data.files import read_file
from data.limits import TABLE_BYTES

_SAID = {"left": 1.0, "right": 0.0, "equal": 0.5}


class TableError(GaitprefError):
    """A table of segments or answers cannot be used."""


@dataclass(frozen=True, eq=False)
class Segments:
    """Stretches of something that was recorded.

    Raises:
        ValueError: shapes do not match, a number is infinite, or an id comes twice.
    """

    ids: tuple[str, ...]
    names: tuple[str, ...]
    rows: np.ndarray
    """[S, T, F] float32, NaN behind the last step of a segment."""

    def __post_init__(self) -> None:
        if self.rows.ndim != 3 or self.rows.shape[::2] != (
            len(self.ids),
            len(self.names),
        ):
            raise ValueError(
                f"rows must be [{len(self.ids)}, T, {len(self.names)}], got "
                f"{list(self.rows.shape)}"
            )
        if not self.rows.size:
            raise ValueError("there must be a segment with a step and a column")
        for what, values in (("segment", self.ids), ("column", self.names)):
            if len(set(values)) != len(values):
                twice = next(each for each in values if values.count(each) > 1)
                raise ValueError(f"the {what} {twice!r} is there twice")
        there = self.valid
        if not there[:, 0].all() or (~there[:, :-1] & there[:, 1:]).any():
            at = self.ids[int((~there[:, 0]).argmax())]
            raise ValueError(f"segment {at!r} or another has a step that is missing")
        if not np.isfinite(self.rows[there]).all():
            raise ValueError("a number is missing or infinite in the middle of a step")

    @property
    def valid(self) -> np.ndarray:
        """[S, T] bool: steps that a segment has."""
        return np.asarray(~np.isnan(self.rows).all(axis=2))


@dataclass(frozen=True, kw_only=True)
class TableAnswer:
    """What somebody said of two segments."""

    left: int
    """Index of the segment."""
    right: int
    target: float
    """Probability that the left one is better."""
    rater: str


def read_segments(path: Path) -> Segments:
    """The segments of an `.npz`, `.csv` or `.parquet` file.

    Raises:
        TableError: it is none; the message says what is wrong.
    """
    readers: dict[str, Callable[[bytes], Segments]] = {
        ".npz": _from_npz,
        ".csv": _from_csv,
        ".parquet": _from_parquet,
    }
    if path.suffix not in readers:
        raise TableError(
            f"{path}: segments come as {', '.join(readers)}, not {path.suffix!r}"
        )
    try:
        return readers[path.suffix](read_file(path, TABLE_BYTES))
    except (ValueError, KeyError, TypeError, OSError, EOFError) as error:
        if isinstance(error, OSError) and error.filename is not None:
            raise
        told = error.args[0] if isinstance(error, KeyError) else error
        raise TableError(
            f"{path} holds no segments ({told}); docs/datasets.md says what it holds"
        ) from error


def read_answers(path: Path, segments: Segments) -> list[TableAnswer]:
    """The answers of a CSV file about `segments`.

    Raises:
        TableError: a line is none; the message names it.
    """
    place = {name: index for index, name in enumerate(segments.ids)}
    lines = csv.DictReader(StringIO(read_file(path, TABLE_BYTES).decode()))
    found = []
    for number, line in enumerate(lines, 2):
        try:
            left, right = place[line["left"]], place[line["right"]]
            if left == right:
                raise ValueError("left and right are one segment")
            target = _target(line["answer"])
        except KeyError as error:
            missing = error.args[0]
            told = (
                f"there is no column {missing!r}"
                if missing in ("left", "right", "answer")
                else f"there is no segment {missing!r}"
            )
            raise TableError(f"{path}, line {number}: {told}") from error
        except ValueError as error:
            raise TableError(f"{path}, line {number}: {error}") from error
        rater = line.get("rater") or "rater"
        found.append(TableAnswer(left=left, right=right, target=target, rater=rater))
    if not found:
        raise TableError(
            f"{path} holds no answers; it needs the columns left, right and answer"
        )
    return found


def _target(text: str) -> float:
    if text in _SAID:
        return _SAID[text]
    try:
        target = float(text)
    except (TypeError, ValueError):
        target = math.nan
    if not 0.0 <= target <= 1.0:
        raise ValueError(
            f"an answer is left, right, equal or the probability that left is better, "
            f"got {text!r}"
        )
    return target


def _from_npz(content: bytes) -> Segments:
    with np.load(BytesIO(content), allow_pickle=False) as arrays:
        rows = np.asarray(arrays["rows"], dtype=np.float32)
        if rows.ndim != 3:
            raise ValueError(f"rows must be [S, T, F], got {list(rows.shape)}")
        count, _, columns = rows.shape
        ids = arrays["ids"] if "ids" in arrays else range(count)
        names = (
            arrays["names"]
            if "names" in arrays
            else [f"column {number}" for number in range(columns)]
        )
        return Segments(tuple(map(str, ids)), tuple(map(str, names)), rows)


def _from_csv(content: bytes) -> Segments:
    lines = csv.DictReader(StringIO(content.decode()))
    names = [name for name in lines.fieldnames or () if name not in ("segment", "step")]
    table = list(lines)
    try:
        columns = {name: [float(line[name]) for line in table] for name in names}
    except (TypeError, ValueError) as error:
        raise ValueError(f"a cell is no number: {error}") from None
    return _in_order([line["segment"] for line in table], columns)


def _from_parquet(content: bytes) -> Segments:
    try:
        from pyarrow import parquet
    except ModuleNotFoundError:
        raise TableError(
            "Parquet tables need the package pyarrow: pip install -e '.[parquet]' -c "
            "constraints.txt; or give an .npz or a .csv"
        ) from None
    table: Any = parquet.read_table(BytesIO(content))
    names = [name for name in table.column_names if name not in ("segment", "step")]
    columns = {name: table[name].to_numpy() for name in names}
    return _in_order(map(str, table["segment"].to_pylist()), columns)


def _in_order(ids: Iterable[str], columns: Mapping[str, Sequence[float]]) -> Segments:
    """Segments of the rows of a table, in the order in which they come."""
    if not columns:
        raise ValueError("there is no column besides segment and step")
    places: dict[str, list[int]] = {}
    for row, name in enumerate(ids):
        places.setdefault(name, []).append(row)
    if not places:
        raise ValueError("there is no row")
    values = np.array(list(columns.values()), dtype=np.float32).T
    if not np.isfinite(values).all():
        raise ValueError("a number is missing or infinite")
    longest = max(map(len, places.values()))
    rows = np.full((len(places), longest, len(columns)), np.nan, dtype=np.float32)
    for index, own in enumerate(places.values()):
        rows[index, : len(own)] = values[own]
    return Segments(tuple(places), tuple(columns), rows)
