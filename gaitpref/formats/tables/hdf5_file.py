"""Tables in HDF5: Minari's data sets, and flat files as D4RL's.

Shapes: N rows, W numbers in a cell.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from data.errors import GaitprefError
from data.files.files import require_regular
from gaitpref.console.extras import require
from gaitpref.formats.logs.log_map import LogError

from .log_table import Table, require_columns, require_numbers

_EPISODE = re.compile(r"episode_(\d{1,9})")
_MINARI = ("data/main_data.hdf5", "main_data.hdf5")
_MOST_NAMES = 1000
_DEEPEST = 6


def read_minari(place: Path, wanted: Collection[str]) -> list[Table]:
    """The arrays `wanted` of every episode; `infos/qpos` is `qpos` in group `infos`.

    Minari keeps one observation more than actions: rows are cut to the shortest array.
    A file without groups of episodes is one table.

    Raises:
        LogError: it is no such data set, or an array is no table of numbers.
        FileError, OSError: it cannot be read.
    """
    path = place
    if place.is_dir():
        found = [place / name for name in _MINARI if (place / name).is_file()]
        if not found:
            raise LogError(
                f"{place} has no {' or '.join(_MINARI)}; give the folder of a Minari "
                "data set in HDF5 (those in Arrow are not read), or an HDF5 file"
            )
        path = found[0]
    require_regular(path)
    h5py = require("h5py", "logs")
    try:
        with h5py.File(path, "r") as file:
            numbers = sorted(
                int(match[1]) for name in file if (match := _EPISODE.fullmatch(name))
            )
            groups = [f"episode_{number}" for number in numbers]
            if not groups:
                return [_table(h5py, str(path), file, wanted, 0)]
            tables: list[Table] = []
            count = 0
            for name in groups:
                group = _own(h5py, file, name)
                tables.append(_table(h5py, f"{path}: {name}", group, wanted, count))
                count += sum(c.size for c in tables[-1].columns.values())
            return tables
    except GaitprefError:
        raise
    except Exception as error:
        # Damaged bytes fail in any way.
        found = " ".join(f"{type(error).__name__}: {error}".split())[:120]
        raise LogError(f"{path} cannot be read as HDF5 ({found})") from error


def _own(h5py: Any, group: Any, name: str) -> Any:
    """What a group holds itself under `name`; None for a link to elsewhere."""
    link = group.get(name, getlink=True)
    return group[name] if isinstance(link, h5py.HardLink) else None


def _table(
    h5py: Any, name: str, group: Any, wanted: Collection[str], before: int
) -> Table:
    """The table of one episode, behind `before` numbers of others."""
    there: dict[str, Any] = {}
    _walk(h5py, group, "", there, 0)
    kept = require_columns(name, wanted, there)
    require_numbers(name, before + sum(math.prod(there[each].shape) for each in kept))
    columns = {each: _numbers(name, each, there[each]) for each in kept}
    rows = min(map(len, columns.values()))
    return Table(name, {each: values[:rows] for each, values in columns.items()})


def _walk(h5py: Any, group: Any, above: str, there: dict[str, Any], depth: int) -> None:
    """Collect the arrays below a group by their paths."""
    if depth > _DEEPEST or not isinstance(group, h5py.Group):
        return
    for name in group:
        if len(there) >= _MOST_NAMES:
            return
        inside = _own(h5py, group, name)
        if isinstance(inside, h5py.Dataset):
            there[above + name] = inside
        else:
            _walk(h5py, inside, f"{above}{name}/", there, depth + 1)


def _numbers(table: str, name: str, values: Any) -> np.ndarray:
    """An array [N, W] that lies in the file itself."""
    if values.is_virtual or values.external:
        raise LogError(f"{table}: {name} lies in another file; it is not followed")
    if values.dtype.kind not in "fiub" or not values.shape:
        raise LogError(
            f"{table}: {name} must hold a row of numbers for each moment, got "
            f"{values.dtype} {list(values.shape)}"
        )
    rows = values.shape[0]
    return np.asarray(values[()], dtype=np.float64).reshape(rows, -1)
