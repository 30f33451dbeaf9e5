"""Memory that begins with what was logged before: data sets, and earlier memories.

What is logged holds observations, actions and feature rows exactly, so it can be
replayed as it was; what cannot be is refused, and said why.

Shapes: T steps of an episode, S rows of a chunk, N columns.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import torch

from data.datasets.dataset import Dataset
from data.episodes.episode import Episode
from data.errors import GaitprefError
from data.files.files import sha256_bytes, sha256_file
from data.files.plain import to_plain
from policy.env.env import QuadrupedEnv
from policy.training.checkpoint import read_plain
from policy.training.policy_error import PolicyError
from policy.training.training_dir import RESUME_NAME

from .ring import Chunk

_AS_ASKED_RAD = 1e-3
"""How far joint targets may be from what actions ask for here."""

Rows = dict[str, np.ndarray]
"""A column of a chunk, or part of one, by name."""


def contents_of(path: Path) -> str:
    """A hash of what `chunk_of` reads there.

    Raises:
        GaitprefError: there is nothing to replay.
    """
    if (path / RESUME_NAME).exists():
        return sha256_file(path / RESUME_NAME)
    names = [entry.sha256 for entry in Dataset.open(path).entries()]
    return sha256_bytes("".join(sorted(names)).encode())


def chunk_of(
    path: Path, env: QuadrupedEnv, columns: int, tell: Callable[[str], None]
) -> Chunk:
    """The steps in `path`, a data set or the directory of an off-policy training, side
    by side in `columns`.

    Raises:
        GaitprefError: there is nothing there that can be replayed in `env`.
    """
    if (path / RESUME_NAME).exists():
        return _of_memory(path, env, columns)
    return _of_dataset(path, env, columns, tell)


def _of_dataset(
    path: Path, env: QuadrupedEnv, width: int, tell: Callable[[str], None]
) -> Chunk:
    if env.cfg.law is not None:
        raise GaitprefError(
            f"--replay {path}: episodes hold what policies of this project see, and "
            "this policy sees something else; leave --replay out, or --observe imu"
        )
    dataset = Dataset.open(path)
    columns: list[list[Rows]] = [[] for _ in range(width)]
    lengths = np.zeros(width, dtype=int)
    reasons: list[str] = []
    episodes = steps = 0
    for entry in dataset.entries():
        episode = dataset.read(entry.sha256)
        if reason := _unfit(episode, env):
            reasons.append(reason)
            continue
        rows = rows_of_episode(episode)
        shortest = int(lengths.argmin())
        columns[shortest].append(rows)
        lengths[shortest] += len(rows["cut"])
        episodes, steps = episodes + 1, steps + entry.num_steps
    if not episodes:
        why = "it holds no episode"
        if reasons:
            why = f"none of its {len(reasons)} episodes fits: {reasons[0]}"
        raise GaitprefError(
            f"--replay {path}: {why}; give a data set that `gaitpref record` made with "
            "this robot"
        )
    left = f", {len(reasons)} left out: {reasons[0]}" if reasons else ""
    tell(f"{path}: {steps:,} steps of {episodes} episodes are replayed{left}")
    return _side_by_side(columns, int(lengths.max()))


def _unfit(episode: Episode, env: QuadrupedEnv) -> str:
    """Why the steps of `episode` are none of `env`; empty where they are."""
    meta = episode.meta
    if meta.model_sha256 != env.robot.model_sha256:
        return f"it is of another robot or ground ({meta.robot})"
    if abs(meta.control_dt_s - env.step_dt) > 1e-9:
        rate, own = 1.0 / meta.control_dt_s, 1.0 / env.step_dt
        return f"it was controlled at {rate:g} Hz, and this training is at {own:g} Hz"
    known = (episode.obs, episode.action, episode.features)
    if not all(np.isfinite(each).all() for each in known):
        return "it lacks numbers, as what a robot does not measure"
    asked = env.targets(torch.from_numpy(episode.action.copy()).to(env.device)).cpu()
    if np.abs(asked.numpy() - episode.ctrl).max() > _AS_ASKED_RAD:
        return "its actions ask for other joint positions than they do here"
    return ""


def rows_of_episode(episode: Episode) -> Rows:
    """The steps of an episode, and its last state as one more row if it went on."""
    steps = len(episode.action)
    goes_on = episode.end_reason == "truncated"
    rows = steps + goes_on
    marks = {name: np.zeros(rows, dtype=bool) for name in ("starts", "fallen", "cut")}
    marks["starts"][[0, steps] if goes_on else [0]] = True
    marks["fallen"][steps - 1] = episode.end_reason == "terminated"
    # Of a simulation that diverged, nothing is known of what came after.
    marks["cut"][-1] = episode.end_reason != "terminated"
    taken = np.minimum(np.arange(rows), steps - 1)
    return {"obs": episode.obs[:rows], "features": episode.features[taken], **marks}


def _side_by_side(columns: list[list[Rows]], rows: int) -> Chunk:
    """A chunk of columns of whole episodes, behind which nothing is known."""
    names = ("obs", "features", "starts", "fallen", "cut")
    first = next(each for column in columns for each in column)
    made: dict[str, np.ndarray] = {
        name: np.zeros((rows, len(columns), *first[name].shape[1:]), first[name].dtype)
        for name in names
    }
    made["cut"][:] = made["starts"][:] = True
    for number, column in enumerate(columns):
        begin = 0
        for episode in column:
            end = begin + len(episode["cut"])
            for name in names:
                made[name][begin:end, number] = episode[name]
            begin = end
        made["obs"][begin:, number] = first["obs"][0]
        made["features"][begin:, number] = first["features"][0]
    return Chunk(**{name: torch.from_numpy(made[name]) for name in names})


def _of_memory(path: Path, env: QuadrupedEnv, width: int) -> Chunk:
    file = path / RESUME_NAME
    state = read_plain(file)
    if "ring" not in state:
        raise PolicyError(
            f"--replay {path}: that training keeps no memory; give the directory of "
            "one with --algorithm fastsac, or a data set"
        )
    was = json.loads(state["identity"])
    for name, own in _identity(env):
        if was.get(name) != own:
            raise PolicyError(
                f"--replay {path}: it was trained with another {name}; give one of "
                "the same robot and environment"
            )
    ring = state["ring"]
    rows, columns = ring["cut"].shape
    if columns != width:
        raise PolicyError(
            f"--replay {path}: its memory has {columns} columns, one an environment; "
            f"give --envs {columns}"
        )
    if not rows:
        raise PolicyError(
            f"--replay {path}: that training took no step yet, and remembers none"
        )
    order = (torch.arange(rows) + int(ring["head"])) % rows
    parts = {
        name: ring[name][order].to(env.device)
        for name in ("obs", "features", "starts", "fallen", "cut")
    }
    # What follows in this memory is not what followed.
    parts["cut"][-1] |= ~parts["fallen"][-1]
    return Chunk(**parts)


def _identity(env: QuadrupedEnv) -> Iterator[tuple[str, object]]:
    yield "robot", env.robot.model_sha256
    yield "env", json.loads(json.dumps(to_plain(env.cfg, whole=True)))
