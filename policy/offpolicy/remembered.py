"""Memory that begins with what was logged before: data sets, and earlier memories.

What is logged holds observations, actions and feature rows exactly, so it can be
replayed as it was; what cannot be is refused, and said why.

"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
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

_NAMES = ("obs", "features", "starts", "fallen", "cut")
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Place:
    """Where steps are to be remembered."""

    env: QuadrupedEnv
    robot_sha256: str
    """Of its robot before it was put on any ground."""
    rows: int
    columns: int


def chunk_of(path: Path, place: Place, tell: Callable[[str], None]) -> Chunk:
    """The steps in `path`, a data set or the directory of an off-policy training, side
    by side, no more than there is room for.

    Raises:
        GaitprefError: there is nothing there that can be replayed.
    """
    if (path / RESUME_NAME).exists():
        return _of_memory(path, place)
    return _of_dataset(path, place, tell)


def _of_dataset(path: Path, place: Place, tell: Callable[[str], None]) -> Chunk:
    env = place.env
    if env.cfg.law is not None:
        raise GaitprefError(
            f"--replay {path}: episodes hold what policies of this project see, and "
            "this policy sees something else; leave --replay out, or --observe imu"
        )
    dataset = Dataset.open(path)
    room, taken = place.rows * place.columns, list[Rows]()
    reasons: list[str] = []
    rows = steps = older = 0
    for entry in reversed(dataset.entries()):
        if rows >= room:
            older += 1
            continue
        episode = dataset.read(entry.sha256)
        if reason := _unfit(episode, env):
            reasons.append(reason)
            continue
        taken.append(rows_of_episode(episode))
        rows, steps = rows + len(taken[-1]["cut"]), steps + entry.num_steps
    if not taken:
        why = "it holds no episode"
        if reasons:
            why = f"none of its {len(reasons)} episodes fits: {reasons[0]}"
        raise GaitprefError(
            f"--replay {path}: {why}; give a data set that `gaitpref record` made with "
            "this robot"
        )
    left = f", {len(reasons)} left out: {reasons[0]}" if reasons else ""
    full = f", {older} before them have no room: --memory gives more" if older else ""
    tell(f"{path}: {steps:,} steps of {len(taken)} episodes are replayed{left}{full}")
    return side_by_side(taken[::-1], place)


def _unfit(episode: Episode, env: QuadrupedEnv) -> str:
    """Why the steps of `episode` are none of `env`; empty where they are."""
    meta = episode.meta
    if meta.is_team:
        return f"it shows a team of two {meta.robot}, and this robot is alone"
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


def side_by_side(episodes: list[Rows], place: Place) -> Chunk:
    """Episodes one after the other, cut into columns of one height; of more than there
    is room for, the last.

    What follows the end of a column stands in the next one, so its last step is no
    more known of than what an episode was when its time was up.
    """
    columns = place.columns
    held = {name: np.concatenate([each[name] for each in episodes]) for name in _NAMES}
    height = min(place.rows, -(-len(held["cut"]) // columns))
    lacking = max(0, height * columns - len(held["cut"]))
    made = {}
    for name, values in held.items():
        filled = np.concatenate([values, np.repeat(values[-1:], lacking, axis=0)])
        if name in ("cut", "starts") and lacking:
            filled[-lacking:] = True
        filled = filled[-height * columns :].reshape(columns, height, *values.shape[1:])
        made[name] = np.ascontiguousarray(filled.swapaxes(0, 1))
    made["starts"][0] = True
    made["cut"][-1] |= ~made["fallen"][-1]
    return Chunk(**{name: torch.from_numpy(each) for name, each in made.items()})


def _of_memory(path: Path, place: Place) -> Chunk:
    env, width = place.env, place.columns
    file = path / RESUME_NAME
    state = read_plain(file)
    if "ring" not in state:
        raise PolicyError(
            f"--replay {path}: that training keeps no memory; give the directory of "
            "one with --algorithm fastsac, or a data set"
        )
    was = json.loads(state["identity"])
    for name, own in _identity(place):
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
    parts = {name: ring[name][order].to(env.device) for name in _NAMES}
    parts["starts"][0] = True
    # What follows in this memory is not what followed.
    parts["cut"][-1] |= ~parts["fallen"][-1]
    return Chunk(**parts)


def _identity(place: Place) -> Iterator[tuple[str, object]]:
    yield "robot", place.robot_sha256
    yield "env", json.loads(json.dumps(to_plain(place.env.cfg, whole=True)))
