"""Habits of two robots beside each other, each as both see it.

How fast one moves away from the other is none of them: it is what a robot that stops
misses of its command, which is its own.

Shapes: R = 2 robots, F + V columns of a row with what is seen of the other,
D descriptors of a robot, P of the pair.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from data.episodes.team_rows import sight_column
from data.features import column
from rewardmodel.descriptors.row import Habit

_CLOSE_M = 0.55
"""Distance of two bases below which legs can touch."""


@dataclass(frozen=True)
class PairHabit(Habit):
    """One habit of a pair."""

    compute: Callable[[Tensor], Tensor]
    """Values [..., R] as either robot sees it, for rows [..., R, F + V]."""


def _place(rows: Tensor) -> Tensor:
    return rows[..., sight_column("mate_pos_h")]


def _gap(rows: Tensor) -> Tensor:
    return torch.linalg.vector_norm(_place(rows), dim=-1)


def _lag(rows: Tensor) -> Tensor:
    return _place(rows)[..., 0].abs()


def _turned(rows: Tensor) -> Tensor:
    return 1 - rows[..., sight_column("mate_turned")][..., 0]


def _turning_apart(rows: Tensor) -> Tensor:
    rates = rows[..., column("base_ang_vel_b")][..., 2]
    return (rates - rates.flip(-1)).abs()


PAIR_HABITS = (
    PairHabit("gap", "m", "distance between both", _gap, group="distance"),
    PairHabit(
        "gap_sq",
        "m2",
        "the same, squared: with `gap` it can name a best distance",
        lambda rows: _gap(rows).square(),
        group="distance",
    ),
    PairHabit(
        "close",
        "m",
        "how much nearer than 0.55 m they are, where legs can touch",
        lambda rows: (_CLOSE_M - _gap(rows)).clamp(min=0),
        group="distance",
    ),
    PairHabit("lag", "m", "how far one is ahead of the other", _lag, group="abreast"),
    PairHabit(
        "lag_sq", "m2", "the same, squared", lambda r: _lag(r).square(), group="abreast"
    ),
    PairHabit(
        "turned", "1", "1 less the cosine between their headings", _turned, group="turn"
    ),
    PairHabit(
        "turning_apart",
        "rad/s",
        "difference of their turning rates",
        _turning_apart,
        group="turn",
    ),
)
PAIR_NAMES = tuple(habit.name for habit in PAIR_HABITS)


def describe_pair(rows: Tensor) -> Tensor:
    """Descriptors [..., P] of rows [..., R, F + V]: the mean of what both see."""
    seen = [habit.compute(rows).mean(dim=-1) for habit in PAIR_HABITS]
    return torch.stack(seen, dim=-1)
