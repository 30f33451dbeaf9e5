"""Tables in Parquet, and LeRobot's folder of them.

Shapes: N rows, W numbers in a cell.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from data.errors import GaitprefError
from data.files.files import open_regular, read_json
from data.files.limits import FACTS_BYTES
from gaitpref.console.extras import require
from gaitpref.formats.logs.log_map import LogError

from .log_table import Table, require_columns, require_numbers

_MOST_FILES = 100_000


def read_parquet(path: Path, wanted: Collection[str]) -> list[Table]:
    """The columns `wanted` of a file; a cell may hold a list of numbers.

    Raises:
        LogError: it is no Parquet, or a column holds something else.
        FileError, OSError: it cannot be read.
    """
    return [Table(str(path), _columns([path], wanted))]


def read_lerobot(folder: Path, wanted: Collection[str]) -> list[Table]:
    """The columns `wanted` of a LeRobot data set, version 2 or 3.

    Version 3 keeps many episodes in a file, version 2 one; `episode_index` tells them
    apart in both.

    Raises:
        LogError: the folder is no such data set, or its videos are asked for.
        FileError, OSError: it cannot be read.
    """
    facts = folder / "meta" / "info.json"
    if not facts.is_file():
        raise LogError(
            f"{folder} has no meta/info.json; give the folder of a LeRobot data set"
        )
    told = read_json(facts, FACTS_BYTES)
    version = told.get("codebase_version") if isinstance(told, dict) else None
    if not str(version).startswith(("v2", "v3")):
        raise LogError(
            f"{facts} tells of codebase_version {str(version)[:20]!r}; versions 2 "
            "and 3 are read"
        )
    files = sorted((folder / "data").glob("chunk-*/*.parquet"))
    if not 0 < len(files) <= _MOST_FILES:
        raise LogError(
            f"{folder} has {len(files)} data/chunk-*/*.parquet files, "
            f"1 to {_MOST_FILES:,} are read; `git lfs pull` fetches what is a pointer"
        )
    return [Table(str(folder), _columns(files, wanted))]


def _columns(files: list[Path], wanted: Collection[str]) -> dict[str, np.ndarray]:
    parts: dict[str, list[np.ndarray]] = {}
    count = 0
    for path in files:
        with open_regular(path) as opened:
            found = _of_file(path, opened, wanted, count)
        count += sum(values.size for values in found.values())
        for name, values in found.items():
            parts.setdefault(name, []).append(values)
    try:
        return {name: np.concatenate(arrays) for name, arrays in parts.items()}
    except ValueError:
        raise LogError(
            f"{files[0].parent}: its files differ in their columns"
        ) from None


def _of_file(
    path: Path, opened: Any, wanted: Collection[str], before: int
) -> dict[str, np.ndarray]:
    """The columns of one file, behind `before` numbers of others."""
    parquet = require("pyarrow.parquet", "logs")
    try:
        file = parquet.ParquetFile(opened)
        kept = require_columns(str(path), wanted, file.schema_arrow.names)
        groups = [file.metadata.row_group(k) for k in range(file.num_row_groups)]
        count = sum(
            part.num_values
            for group in groups
            for part in (group.column(k) for k in range(group.num_columns))
            if part.path_in_schema.partition(".")[0] in kept
        )
        require_numbers(str(path), before + max(count, file.metadata.num_rows))
        table = file.read(columns=kept)
        return {name: _numbers(path, name, table[name]) for name in kept}
    except GaitprefError:
        raise
    except Exception as error:
        # Damaged bytes fail in any way.
        found = " ".join(f"{type(error).__name__}: {error}".split())[:120]
        raise LogError(f"{path} cannot be read as Parquet ({found})") from error


def _numbers(path: Path, name: str, column: Any) -> np.ndarray:
    """A column [N, W]; every cell holds as many numbers as the others."""
    pa = require("pyarrow", "logs")
    types = pa.types
    values, rows = column.combine_chunks(), len(column)
    kind = values.type
    if (
        types.is_list(kind)
        or types.is_large_list(kind)
        or types.is_fixed_size_list(kind)
    ):
        if values.null_count:
            raise LogError(f"{path}: {name} has rows without a list")
        inside = values.flatten()
        width = len(inside) // rows if rows else 0
        lengths = values.value_lengths() if hasattr(values, "value_lengths") else None
        if lengths is not None and len(lengths.unique()) > 1:
            raise LogError(f"{path}: {name} holds lists of different lengths")
        values, kind = inside, inside.type
    else:
        width = 1
    whole = types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind)
    if not whole:
        raise LogError(f"{path}: {name} must hold numbers, got {kind}")
    numbers = values.cast(pa.float64()).to_numpy(zero_copy_only=False)
    return numbers.astype(np.float64).reshape(rows, width)
