"""Export as a LeRobot data set, version 3.0: Parquet and some JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from data.datasets.dataset import EpisodeEntry
from data.episodes.episode import Episode
from data.features import JOINTS
from gaitpref.console.extras import require

from .export_source import Exported, Source, new_directory, task_text

_FILE_ROWS = 200_000
"""Some 60 MB: LeRobot wants files below 100 MB, and 1,000 of them in a chunk."""
_CHUNK_FILES = 1000
_WIDE = {"observation.state": 48, "action": 12}
_SCALARS = {
    "next.reward": "float32",
    "next.done": "bool",
    "next.truncated": "bool",
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}


def export_lerobot(source: Source, out: Path) -> Exported:
    """Write `data/`, `meta/`; `LeRobotDataset(repo_id, root=out)` opens it.

    A frame is an observation with the action that followed: T frames an episode.

    Raises:
        GaitprefError: `out` is there, an episode cannot be used, or pyarrow is missing.
    """
    pa, pq = require("pyarrow", "export"), require("pyarrow.parquet", "export")
    tasks = list(dict.fromkeys(task_text(entry) for entry in source.entries))
    rows: list[dict[str, Any]] = []
    stats: list[dict[str, dict[str, np.ndarray]]] = []
    with new_directory(source, out) as partial:
        for number, part in enumerate(_files(source)):
            chunk, file = divmod(number, _CHUNK_FILES)
            tables = []
            for index, first, entry, episode in part:
                task = tasks.index(task_text(entry))
                columns = _columns(episode, index, first, task)
                tables.append(_table(pa, columns))
                stats.append(_stats(columns))
                rows.append(_episode_row(entry, index, first, chunk, file))
            path = partial / f"data/chunk-{chunk:03d}/file-{file:03d}.parquet"
            path.parent.mkdir(parents=True, exist_ok=True)
            pq.write_table(pa.concat_tables(tables), path)
        meta = partial / "meta"
        episodes = meta / "episodes/chunk-000/file-000.parquet"
        episodes.parent.mkdir(parents=True)
        flat = [row | _flat(stat) for row, stat in zip(rows, stats, strict=True)]
        pq.write_table(pa.Table.from_pylist(flat), episodes)
        pq.write_table(_task_table(pa, tasks), meta / "tasks.parquet")
        _write_json(meta / "info.json", _info(source, len(tasks)))
        _write_json(meta / "stats.json", _together(stats))
    return Exported(str(out), len(source.entries), source.steps, 0, source.left_out, 0)


Numbered = tuple[int, int, EpisodeEntry, Episode]


def _files(source: Source) -> Iterator[list[Numbered]]:
    """Index, first row, entry and episode of everything that goes into one file."""
    part: list[Numbered] = []
    rows = first = 0
    for index, (entry, episode) in enumerate(
        zip(source.entries, source.episodes(), strict=True)
    ):
        if part and rows + entry.num_steps > _FILE_ROWS:
            yield part
            part, rows = [], 0
        part.append((index, first, entry, episode))
        rows += entry.num_steps
        first += entry.num_steps
    yield part


def _columns(
    episode: Episode, index: int, first: int, task: int
) -> dict[str, np.ndarray]:
    steps = np.arange(episode.num_steps)
    last = steps == episode.num_steps - 1
    return {
        "observation.state": episode.obs[:-1],
        "action": episode.action,
        "next.reward": episode.reward,
        "next.done": last,
        "next.truncated": last & (episode.end_reason == "truncated"),
        "timestamp": (steps * episode.meta.control_dt_s).astype(np.float32),
        "frame_index": steps,
        "episode_index": np.full_like(steps, index),
        "index": first + steps,
        "task_index": np.full_like(steps, task),
    }


def _table(pa: Any, columns: dict[str, np.ndarray]) -> Any:
    arrays = {}
    for name, values in columns.items():
        flat = pa.array(np.ascontiguousarray(values).ravel())
        wide = values.ndim == 2
        arrays[name] = (
            pa.FixedSizeListArray.from_arrays(flat, values.shape[1]) if wide else flat
        )
    return pa.table(arrays)


def _stats(columns: dict[str, np.ndarray]) -> dict[str, dict[str, np.ndarray]]:
    found = {}
    for name, values in columns.items():
        rows = values.reshape(len(values), -1).astype(np.float64)
        found[name] = {
            "min": rows.min(axis=0),
            "max": rows.max(axis=0),
            "mean": rows.mean(axis=0),
            "std": rows.std(axis=0),
            "count": np.array([len(rows)]),
        }
    return found


def _together(stats: list[dict[str, dict[str, np.ndarray]]]) -> dict[str, Any]:
    """The statistics of all episodes as one."""
    found: dict[str, Any] = {}
    for name in stats[0]:
        parts = [stat[name] for stat in stats]
        counts = np.array([part["count"] for part in parts], dtype=float)
        share = counts / counts.sum()
        mean = (share * [part["mean"] for part in parts]).sum(axis=0)
        squares = [part["std"] ** 2 + (part["mean"] - mean) ** 2 for part in parts]
        found[name] = {
            "min": np.min([part["min"] for part in parts], axis=0).tolist(),
            "max": np.max([part["max"] for part in parts], axis=0).tolist(),
            "mean": mean.tolist(),
            "std": np.sqrt((share * squares).sum(axis=0)).tolist(),
            "count": [int(counts.sum())],
        }
    return found


def _flat(stat: dict[str, dict[str, np.ndarray]]) -> dict[str, Any]:
    return {
        f"stats/{name}/{kind}": values.tolist()
        for name, kinds in stat.items()
        for kind, values in kinds.items()
    }


def _episode_row(
    entry: EpisodeEntry, index: int, first: int, chunk: int, file: int
) -> dict[str, Any]:
    return {
        "episode_index": index,
        "tasks": [task_text(entry)],
        "length": entry.num_steps,
        "data/chunk_index": chunk,
        "data/file_index": file,
        "dataset_from_index": first,
        "dataset_to_index": first + entry.num_steps,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
        "rollout_sha256": entry.sha256,
    }


def _task_table(pa: Any, tasks: list[str]) -> Any:
    """Tasks as pandas keeps them: the text is the index of the row."""
    name = "__index_level_0__"
    table = pa.table({"task_index": list(range(len(tasks))), name: tasks})
    columns = [
        {
            "name": column,
            "field_name": field,
            "pandas_type": kind,
            "numpy_type": numpy_type,
            "metadata": None,
        }
        for column, field, kind, numpy_type in (
            ("task_index", "task_index", "int64", "int64"),
            (None, name, "unicode", "object"),
        )
    ]
    about = {"index_columns": [name], "column_indexes": [], "columns": columns}
    return table.replace_schema_metadata({"pandas": json.dumps(about)})


def _info(source: Source, num_tasks: int) -> dict[str, Any]:
    robots = sorted({entry.meta.robot for entry in source.entries})
    features: dict[str, Any] = {
        name: {"dtype": "float32", "shape": [width], "names": None}
        for name, width in _WIDE.items()
    }
    features["action"]["names"] = list(JOINTS)
    features |= {
        name: {"dtype": dtype, "shape": [1], "names": None}
        for name, dtype in _SCALARS.items()
    }
    return {
        "codebase_version": "v3.0",
        "robot_type": ", ".join(robots),
        "total_episodes": len(source.entries),
        "total_frames": source.steps,
        "total_tasks": num_tasks,
        "chunks_size": _CHUNK_FILES,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": round(source.control_hz),
        "splits": {"train": f"0:{len(source.entries)}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": features,
    }


def _write_json(path: Path, value: Any) -> None:
    path.write_text(json.dumps(value, indent=1))
