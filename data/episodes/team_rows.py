"""What two robots of a team see of each other, and their feature rows side by side.

The frame of a robot is level and turned with its heading, so that leaning changes
nothing of where the other one is.

Shapes: R = 2 robots of a team, T steps, F columns of the feature row, V columns of what
is seen of the other.
"""

from __future__ import annotations

import numpy as np

from data.errors import DatasetError
from data.features import FEATURE_DIM, Feature

from .episode_records import Episode

SIGHT = (
    Feature("mate_pos_h", 2, "m", "where the other is: ahead and to the left"),
    Feature("mate_turned", 2, "1", "cosine and sine of its heading less the own"),
    Feature("mate_vel_h", 2, "m/s", "its velocity less the own: ahead and to the left"),
)
"""Columns of what a robot sees of the other, behind those of its own row."""
SIGHT_DIM = sum(part.width for part in SIGHT)


def sight_column(name: str) -> slice:
    """The slice of the last axis of `rows [..., F + V]` that holds `name`.

    Raises:
        ValueError: there is no such part.
    """
    start = FEATURE_DIM
    for part in SIGHT:
        if part.name == name:
            return slice(start, start + part.width)
        start += part.width
    known = ", ".join(part.name for part in SIGHT)
    raise ValueError(f"nothing called {name!r} is seen of a mate; there are: {known}")


def team_sight(qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
    """What each robot sees of the other, [..., R, V] float32.

    Args:
        qpos: [..., R, 7 or more] m and wxyz of the bases first, world frame.
        qvel: [..., R, 2 or more] m/s of the bases first, world frame.
    """
    w, x, y, z = np.moveaxis(qpos[..., 3:7], -1, 0)
    heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    turned = _other(heading) - heading
    parts = [
        _in_heading(_other(vectors[..., :2], -2) - vectors[..., :2], heading)
        for vectors in (qpos, qvel)
    ]
    turns = np.stack([np.cos(turned), np.sin(turned)], axis=-1)
    seen = np.concatenate([parts[0], turns, parts[1]], axis=-1)
    return seen.astype(np.float32)


def team_rows(episode: Episode) -> np.ndarray:
    """Rows [T, R, F + V] float32 of both robots of an episode, after each step.

    Raises:
        DatasetError: it shows one robot alone.
    """
    if episode.mate is None:
        raise DatasetError(
            f"an episode of {episode.meta.robot!r} shows one robot alone, a team is "
            "two; `gaitpref team record` adds some"
        )
    both = episode.robots
    own = np.stack([robot.features for robot in both], axis=1)
    states = [
        np.stack([getattr(robot, name)[1:] for robot in both], axis=1)
        for name in ("qpos", "qvel")
    ]
    return np.concatenate([own, team_sight(*states)], axis=-1)


def _other(values: np.ndarray, axis: int = -1) -> np.ndarray:
    """`values` of the other robot, along the axis R."""
    return np.flip(values, axis)


def _in_heading(vectors: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """Vectors [..., 2] of the world, ahead and to the left of `heading` [...] rad."""
    c, s = np.cos(heading), np.sin(heading)
    x, y = np.moveaxis(vectors, -1, 0)
    return np.stack([c * x + s * y, c * y - s * x], axis=-1)
