"""Tables in CSV and NPZ.

Shapes: N rows, W numbers in a cell.
"""

from __future__ import annotations

import array
import csv
import io
import math
import zipfile
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import IO, Protocol

import numpy as np

from data.files.files import open_regular, require_regular
from data.files.limits import LOG_TABLE_BYTES
from gaitpref.formats.logs.log_map import LogError

from .log_table import Table, require_columns, require_numbers, told_of

_DELIMITERS = ",;\t"
_LONGEST_LINE = 2**20


class _Lines(Protocol):
    """What `csv.reader` gives."""

    line_num: int

    def __iter__(self) -> Iterator[list[str]]: ...


def read_csv(path: Path, wanted: Collection[str]) -> list[Table]:
    """The columns `wanted` of a table whose first line names them.

    The delimiter is comma, semicolon or tab, whichever the first line has most of.

    Raises:
        LogError: a cell is no number; the message names its line.
        FileError, OSError: it cannot be read, or is too long.
    """
    require_regular(path, LOG_TABLE_BYTES)
    with open_regular(path) as raw:
        text = io.TextIOWrapper(raw, encoding="utf-8-sig", newline="")
        try:
            first = text.readline(_LONGEST_LINE)
            mark = max(_DELIMITERS, key=first.count)
            names = [name.strip() for name in next(csv.reader([first], delimiter=mark))]
            if len(set(names)) != len(names):
                raise LogError(f"{path}: two columns have one name{told_of(names)}")
            kept = require_columns(str(path), wanted, names)
            places = [names.index(name) for name in kept]
            cells = _cells(path, csv.reader(text, delimiter=mark), len(names), places)
        except (UnicodeDecodeError, csv.Error, StopIteration) as error:
            raise LogError(f"{path} is no table in CSV ({error})") from None
    values = np.frombuffer(cells, dtype=np.float64).reshape(-1, len(kept))
    columns = {name: values[:, [k]] for k, name in enumerate(kept)}
    return [Table(str(path), columns)]


def _cells(
    path: Path, lines: _Lines, width: int, places: list[int]
) -> array.array[float]:
    cells = array.array("d")
    for line in lines:
        number = lines.line_num + 1
        if not line:
            continue
        if len(line) != width:
            raise LogError(
                f"{path}, line {number}: {len(line)} cells, where the first line "
                f"names {width} columns"
            )
        try:
            cells.extend(
                float(line[k]) if line[k].strip() else math.nan for k in places
            )
        except ValueError as error:
            raise LogError(
                f"{path}, line {number}: a cell is no number: {error}"
            ) from None
    return cells


def read_npz(path: Path, wanted: Collection[str]) -> list[Table]:
    """The arrays `wanted` of an `.npz`, one row a moment; objects are not unpickled.

    Raises:
        LogError: it is none, or an array is no table of numbers.
        FileError, OSError: it cannot be read.
    """
    require_regular(path, LOG_TABLE_BYTES)
    try:
        with open_regular(path) as raw, zipfile.ZipFile(raw) as archive:
            members = {
                info.filename.removesuffix(".npy"): info
                for info in archive.infolist()
                if info.filename.endswith(".npy")
            }
            kept = require_columns(str(path), wanted, members)
            sizes = sum(members[name].file_size for name in kept)
            require_numbers(str(path), sizes // 8)
            columns: dict[str, np.ndarray] = {}
            for name in kept:
                with archive.open(members[name]) as member:
                    columns[name] = _array(path, name, member, members[name].file_size)
    except (zipfile.BadZipFile, NotImplementedError, EOFError, RuntimeError) as error:
        raise LogError(f"{path} is no whole .npz ({error})") from None
    return [Table(str(path), columns)]


def _array(path: Path, name: str, member: IO[bytes], size: int) -> np.ndarray:
    """The array of a member, if it is as large as it claims: [N, W]."""
    try:
        version = np.lib.format.read_magic(member)
        read = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }[version]
        shape, fortran, dtype = read(member)
    except (ValueError, KeyError, SyntaxError) as error:
        raise LogError(f"{path}: {name} is no array ({error})") from None
    if dtype.hasobject or dtype.kind not in "fiub" or not shape:
        raise LogError(
            f"{path}: {name} must hold a row of numbers for each moment, got "
            f"{dtype} {list(shape)}"
        )
    count = math.prod(shape)
    content = member.read(size)
    if len(content) != count * dtype.itemsize:
        raise LogError(
            f"{path}: {name} claims to be {dtype} {list(shape)}, and has "
            f"{len(content)} bytes"
        )
    values = np.frombuffer(content, dtype=dtype)
    values = values.reshape(shape, order="F" if fortran else "C")
    return values.reshape(shape[0], -1).astype(np.float64)
