"""The learned reward of every step of a data set, as a Parquet table.

Shapes: T steps of an episode.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from data.datasets.dataset import Dataset
from data.files.files import fsync_directory, require_replaceable
from gaitpref.console.extras import require
from rewardmodel.models.model import RewardModel

pa = require("pyarrow", "parquet")
pq = require("pyarrow.parquet", "parquet")

_ROWS = 100_000
"""Steps of a row group, some megabytes."""
_SCHEMA = pa.schema(
    [
        ("episode", pa.string()),
        ("step", pa.uint32()),
        ("reward", pa.float32()),
        ("spread", pa.float32()),
    ],
    metadata={"reward": "per second, centred, unit deviation on the fitted clips"},
)


def write_rewards(
    path: Path,
    dataset: Dataset,
    model: RewardModel,
    tell: Callable[[int, int], None] = lambda done, of: None,
) -> int:
    """Score every episode, in the order of their hashes; gives the number of steps.

    `spread` is the standard deviation over the ensemble. The file appears when it is
    whole.

    Raises:
        FileError: something else than a file is there.
        OSError: the disk is full or not writable.
        DatasetError, EpisodeError: an episode is missing or damaged.
    """
    require_replaceable(path)
    partial = path.with_name(f".{path.name}.{secrets.token_hex(8)}.tmp")
    steps = 0
    try:
        with pq.ParquetWriter(partial, _SCHEMA) as writer:
            tables: list[Any] = []
            rows = 0
            entries = dataset.entries()
            for done, entry in enumerate(entries):
                tell(done, len(entries))
                tables.append(_table(entry.sha256, dataset, model))
                rows += entry.num_steps
                steps += entry.num_steps
                if rows >= _ROWS:
                    writer.write_table(pa.concat_tables(tables))
                    tables, rows = [], 0
            if tables:
                writer.write_table(pa.concat_tables(tables))
        partial.replace(path)
        fsync_directory(path.parent)
    finally:
        partial.unlink(missing_ok=True)
    return steps


def _table(sha256: str, dataset: Dataset, model: RewardModel) -> Any:
    reward, spread = model.episode_rewards(torch.tensor(dataset.features(sha256)))
    count = len(reward)
    names = pa.array([sha256]).take(pa.array([0] * count))
    columns = [names, torch.arange(count).numpy(), reward.numpy(), spread.numpy()]
    arrays = [
        pa.array(column, field.type)
        for column, field in zip(columns, _SCHEMA, strict=True)
    ]
    return pa.Table.from_arrays(arrays, schema=_SCHEMA)
