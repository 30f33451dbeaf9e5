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
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from data.errors import GaitprefError
from data.files.files import read_file
from data.files.limits import TABLE_BYTES

_SAID = {"left": 1.0, "right": 0.0, "equal": 0.5}
_SEGMENT, _STEP = "segment", "step"
_SPARSEST = 20
"""Times as many steps as there are that may be kept for segments of unequal length."""
_FEW_STEPS = 1_000_000
_DAMAGE = (
    ValueError,
    KeyError,
    TypeError,
    EOFError,
    MemoryError,
    BadZipFile,
    zlib.error,
    csv.Error,
)
"""What reading a damaged file raises."""


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
    """[S, T, F] float, NaN behind the last step of a segment."""

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
    end = path.suffix.lower()
    if end not in readers:
        raise TableError(
            f"{path}: segments come as {', '.join(readers)}, not {path.suffix!r}"
        )
    try:
        return readers[end](read_file(path, TABLE_BYTES))
    except _DAMAGE as error:
        told = f"there is no {error}" if isinstance(error, KeyError) else error
        raise TableError(
            f"{path} holds no segments ({told}); docs/how-to/fit-a-table.md says what "
            "it holds"
        ) from error


def read_answers(path: Path, segments: Segments) -> list[TableAnswer]:
    """The answers of a CSV file about `segments`.

    Raises:
        TableError: a line is none; the message names it.
    """
    place = {name: index for index, name in enumerate(segments.ids)}
    number = 1
    found = []
    try:
        names, lines = _table(read_file(path, TABLE_BYTES))
        for name in ("left", "right", "answer"):
            if name not in names:
                raise ValueError(f"there is no column {name!r}")
        for number, line in lines:  # noqa: B007 - an error names it
            found.append(_answer_of(dict(zip(names, line, strict=True)), place))
    except _DAMAGE as error:
        raise TableError(f"{path}, line {number}: {error}") from error
    if not found:
        raise TableError(
            f"{path} holds no answers; it needs the columns left, right and answer"
        )
    return found


def _answer_of(line: dict[str, str], place: dict[str, int]) -> TableAnswer:
    for side in (line["left"], line["right"]):
        if side not in place:
            raise ValueError(f"there is no segment {side!r}")
    if line["left"] == line["right"]:
        raise ValueError("left and right are one segment")
    return TableAnswer(
        left=place[line["left"]],
        right=place[line["right"]],
        target=_target(line["answer"]),
        rater=line.get("rater") or "rater",
    )


def _table(content: bytes) -> tuple[list[str], Iterator[tuple[int, list[str]]]]:
    """Names of the columns of a CSV table, and its lines with their numbers."""
    lines = csv.reader(StringIO(content.decode("utf-8-sig"), newline=""))
    names = next(lines, [])
    if len(set(names)) != len(names):
        raise ValueError("two columns have one name")

    def each() -> Iterator[tuple[int, list[str]]]:
        for line in lines:
            if line and len(line) != len(names):
                raise ValueError(
                    f"line {lines.line_num} has {len(line)} cells, the first "
                    f"{len(names)}"
                )
            if line:
                yield lines.line_num, line

    return names, each()


def _target(text: str) -> float:
    if text in _SAID:
        return _SAID[text]
    try:
        target = float(text)
    except ValueError:
        target = math.nan
    if not 0.0 <= target <= 1.0:
        raise ValueError(
            f"an answer is left, right, equal or the probability that left is better, "
            f"got {text!r}"
        )
    return target


def _from_npz(content: bytes) -> Segments:
    with np.load(BytesIO(content), allow_pickle=False) as arrays:
        rows = arrays["rows"]
        if rows.dtype != np.float32:
            rows = rows.astype(np.float64)
        if rows.ndim != 3:
            raise ValueError(f"rows must be [S, T, F], got {list(rows.shape)}")
        count, _, columns = rows.shape
        ids = arrays["ids"] if "ids" in arrays else range(count)
        names = (
            arrays["names"]
            if "names" in arrays
            else [f"column {number}" for number in range(columns)]
        )
        return Segments(tuple(map(_word, ids)), tuple(map(_word, names)), rows)


def _from_csv(content: bytes) -> Segments:
    names, lines = _table(content)
    where = _segment_column(names)
    ids: list[str] = []
    values: list[list[float]] = []
    kept = [i for i, name in enumerate(names) if name not in (_SEGMENT, _STEP)]
    for number, line in lines:
        ids.append(line[where])
        try:
            values.append([float(line[i]) for i in kept])
        except ValueError as error:
            raise ValueError(f"line {number}: a cell is no number: {error}") from None
    table = np.array(values).reshape(len(values), len(kept))
    return _in_order(ids, [names[i] for i in kept], table)


def _from_parquet(content: bytes) -> Segments:
    try:
        from pyarrow import parquet, types
    except ModuleNotFoundError:
        raise TableError(
            "Parquet tables need the package pyarrow: pip install -e '.[parquet]' -c "
            "constraints.txt; or give an .npz or a .csv"
        ) from None
    try:
        table: Any = parquet.read_table(BytesIO(content))
        _segment_column(table.column_names)
        names = [name for name in table.column_names if name not in (_SEGMENT, _STEP)]
        for name in names:
            kind = table.schema.field(name).type
            if not any(
                is_one(kind)
                for is_one in (types.is_integer, types.is_floating, types.is_boolean)
            ):
                raise ValueError(f"the column {name!r} holds {kind}, and no numbers")
        ids = table[_SEGMENT].to_pylist()
        columns = [table[name].to_numpy() for name in names]
    except OSError as error:
        # So pyarrow calls damage.
        raise ValueError(error) from None
    if None in ids:
        raise ValueError("a row has no segment")
    values = np.array(columns, dtype=np.float64).T.reshape(len(ids), len(names))
    return _in_order(list(map(_word, ids)), names, values)


def _word(value: Any) -> str:
    """An id or a name as it is written in a table of text: 1 for 1.0."""
    if isinstance(value, bytes):
        return value.decode()
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return str(value)


def _segment_column(names: Sequence[str]) -> int:
    if _SEGMENT not in names:
        raise ValueError(f"there is no column {_SEGMENT!r}, but {', '.join(names)}")
    return list(names).index(_SEGMENT)


def _in_order(ids: Sequence[str], names: Sequence[str], values: np.ndarray) -> Segments:
    """Segments of the rows [K, F] of a table, in the order in which they come."""
    if not names:
        raise ValueError("there is no column besides segment and step")
    if not ids:
        raise ValueError("there is no row")
    if not np.isfinite(values).all():
        raise ValueError("a number is missing or infinite")
    places: dict[str, list[int]] = {}
    for row, name in enumerate(ids):
        places.setdefault(name, []).append(row)
    longest = max(map(len, places.values()))
    if len(places) * longest > _SPARSEST * len(ids) + _FEW_STEPS:
        raise ValueError(
            f"the longest segment has {longest} steps, {len(ids) // len(places)} in "
            f"the mean: cut it to the length of the others"
        )
    shape = (len(places), longest, len(names))
    rows = np.full(shape, np.nan)
    for index, own in enumerate(places.values()):
        rows[index, : len(own)] = values[own]
    return Segments(tuple(places), tuple(names), rows)
