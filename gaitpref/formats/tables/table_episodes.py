"""From a table to episodes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

from data.files.telling import Tell, silent
from gaitpref.formats.logs.log_episodes import (
    LogEpisodes,
    log_episodes,
    robot_of,
    source_of,
)
from gaitpref.formats.logs.log_findings import Findings
from gaitpref.formats.logs.log_map import Columns, LogError, LogMap

from .csv_npz import read_csv, read_npz
from .hdf5_file import read_minari
from .log_table import Reader
from .parquet import read_lerobot, read_parquet
from .rows_told import recordings_of_table, wanted_of

_HASHED = (".parquet", ".hdf5", ".json")
"""Files of a folder that make its hash."""
Form = Literal["csv", "npz", "parquet", "lerobot", "minari"]
_READERS: dict[Form, Reader] = {
    "csv": read_csv,
    "npz": read_npz,
    "parquet": read_parquet,
    "lerobot": read_lerobot,
    "minari": read_minari,
}


def table_episodes(
    place: Path, form: Form, log_map: LogMap, root: Path, tell: Tell = silent
) -> LogEpisodes:
    """Every stretch of a table in which joints and base are known.

    Args:
        place: A file, or the folder of a LeRobot or Minari data set.
        form: What it is.
        log_map: What its columns mean.
        root: Directory the map's paths start from.
        tell: Gets the stretches that are worked out.

    Raises:
        LogError, RobotError: the table, its map or the robot cannot be used.
    """
    if not place.exists():
        raise LogError(f"{place} is missing; give a table")
    columns = log_map.columns
    if columns is None:
        raise LogError(
            f"the map has no table [columns], which says what the columns of {place} "
            "mean; docs/reference/log-map.md lists its fields"
        )
    if form == "lerobot":
        columns = _with_lerobots_names(columns)
    findings = Findings()
    tables = _READERS[form](place, wanted_of(columns))
    robot = robot_of(log_map, root)
    recordings = [
        recording
        for table in tables
        for recording in recordings_of_table(table, columns, log_map, robot, findings)
    ]
    source = source_of(form, place, _files(place))
    return log_episodes(recordings, log_map, robot, findings, source=source, tell=tell)


def _with_lerobots_names(columns: Columns) -> Columns:
    """`columns` with what every LeRobot data set calls time and episode."""
    timed = columns.time or columns.rate_hz is not None
    return replace(
        columns,
        time=columns.time if timed else "timestamp",
        episode=columns.episode or "episode_index",
    )


def _files(place: Path) -> list[Path]:
    """What makes the hash of a log."""
    if place.is_file():
        return [place]
    return sorted(path for path in place.rglob("*") if path.suffix in _HASHED)
