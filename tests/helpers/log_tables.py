"""One motion as tables of several forms, and the map of their columns."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import h5py
import numpy as np
import pyarrow
from pyarrow import parquet

from policy.robots.robot import Robot
from tests.helpers.motion import trot_qpos


def write_tables(folder: Path, robot: Robot) -> None:
    """Write columns.toml, walk.csv and the folders lerobot and minari."""
    times_s = np.arange(150) * 0.02
    names = [f"q{k}" for k in range(19)]
    states = trot_qpos(robot, times_s, 0.5).T
    columns = {"t": times_s, **dict(zip(names, states, strict=True))}
    (folder / "columns.toml").write_text(
        f'robot = "go1"\n[columns]\ntime = "t"\nqpos = {json.dumps(names)}\n'
    )
    with (folder / "walk.csv").open("w", newline="") as file:
        lines = csv.writer(file)
        lines.writerow(columns)
        lines.writerows(zip(*columns.values(), strict=True))
    table = pyarrow.table(columns)
    (folder / "lerobot/meta").mkdir(parents=True)
    facts = {"codebase_version": "v3.0"}
    (folder / "lerobot/meta/info.json").write_text(json.dumps(facts))
    chunk = folder / "lerobot/data/chunk-000"
    chunk.mkdir(parents=True)
    numbered = table.append_column("episode_index", pyarrow.array([0] * len(times_s)))
    parquet.write_table(numbered, chunk / "file-000.parquet")
    (folder / "minari/data").mkdir(parents=True)
    with h5py.File(folder / "minari/data/main_data.hdf5", "w") as file:
        for name, values in columns.items():
            file[f"episode_0/{name}"] = values
