"""`gaitpref data view`: clips as a file that viewers open, and a layout beside it.

Shapes: S states of a clip, K bodies of the robot.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from data.episodes.episode import Episode
from data.errors import DatasetError
from data.files.files import write_atomically
from gaitpref.console.extras import require
from labeling_ui.scene.geometry import multiply_wxyz, robot_geometry

from .layout import foxglove_layout
from .messages import (
    SCALARS_TYPE,
    SCENE_TYPE,
    TF_TYPE,
    Message,
    definitions,
    scalars,
    transforms,
)
from .scene_messages import frame_names, scene

_APART_M = 1.2
"""Between the tracks of two clips that run side by side."""


def layout_path(out: Path) -> Path:
    """Where the layout for the file `out` is put."""
    return out.with_suffix(".layout.json")


def write_view(out: Path, dataset: Dataset, clips: dict[str, Clip]) -> None:
    """Write clips, by the name of their topics, all from time 0 and side by side.

    Raises:
        DatasetError, EpisodeError: an episode is missing or damaged.
        OSError: the disk is full or not writable.
    """
    writer_of = require("mcap_ros2.writer", "view").Writer
    stream = BytesIO()
    with writer_of(stream) as writer:
        schemas = {n: writer.register_msgdef(n, t) for n, t in definitions().items()}
        rows: list[tuple[int, str, str, Message]] = []
        for number, (name, clip) in enumerate(clips.items()):
            shift_m = (len(clips) - 1) / 2 - number
            episode = _episode(dataset, clip)
            rows += _messages(episode, clip, name, shift_m * _APART_M)
            writer.add_metadata(f"clip {name}", _provenance(episode, clip))
        for time_ns, topic, kind, message in sorted(rows, key=lambda row: row[0]):
            writer.write_message(topic, schemas[kind], message, time_ns, time_ns)
    write_atomically(out, stream.getvalue())
    layout = json.dumps(foxglove_layout(list(clips)), indent=1)
    write_atomically(layout_path(out), layout.encode())


def _episode(dataset: Dataset, clip: Clip) -> Episode:
    episode = dataset.read(clip.rollout)
    if clip.stop > episode.num_steps:
        raise DatasetError(
            f"clip {clip.key} ends at step {clip.stop}, its episode has "
            f"{episode.num_steps}; the pairs belong to another data set"
        )
    return episode


def _provenance(episode: Episode, clip: Clip) -> dict[str, str]:
    where = {"rollout": clip.rollout, "start": str(clip.start)}
    return where | {"steps": str(clip.steps)} | episode.meta.to_strings()


def _messages(
    episode: Episode, clip: Clip, name: str, shift_m: float
) -> Iterator[tuple[int, str, str, Message]]:
    """Time, topic, type and value of everything that is shown of a clip."""
    mj_model = robot_geometry(episode.mjcf).mj_model
    frames = frame_names(mj_model, name)
    positions, wxyzs = body_poses(
        mj_model, episode.world_qpos[clip.start : clip.stop + 1], shift_m
    )
    step_ns = round(episode.meta.control_dt_s * 1e9)
    yield 0, f"/{name}/scene", SCENE_TYPE, scene(mj_model, name)
    for state in range(clip.steps + 1):
        time_ns = state * step_ns
        pose = transforms(time_ns, frames, positions[state], wxyzs[state])
        yield time_ns, f"/{name}/tf", TF_TYPE, pose
    for step in range(clip.steps):
        # What a step led to is known at its end.
        time_ns, row = (step + 1) * step_ns, clip.start + step
        numbers = scalars(time_ns, episode.features[row], episode.reward[row])
        yield time_ns, f"/{name}/scalars", SCALARS_TYPE, numbers


def body_poses(
    mj_model: Any, qpos: np.ndarray, shift_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Where the bodies are in the states `qpos` [S, nq], the first heading along x.

    Returns:
        Positions [S, K - 1, 3] in m, from where the clip starts and `shift_m` to its
        left, and attitudes [S, K - 1, 4] wxyz; without the world.
    """
    mj_data = mujoco.MjData(mj_model)
    positions = np.empty((len(qpos), mj_model.nbody - 1, 3))
    wxyzs = np.empty((len(qpos), mj_model.nbody - 1, 4))
    for row, state in enumerate(qpos):
        mj_data.qpos[:] = state
        mujoco.mj_kinematics(mj_model, mj_data)
        positions[row], wxyzs[row] = mj_data.xpos[1:], mj_data.xquat[1:]
    w, x, y, z = qpos[0, 3:7]
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    start = np.array([*qpos[0, :2], 0.0])
    back = np.array([np.cos(yaw / 2), 0, 0, -np.sin(yaw / 2)])
    shift = np.array([0.0, shift_m, 0.0])
    return (positions - start) @ turn.T + shift, multiply_wxyz(back, wxyzs)
