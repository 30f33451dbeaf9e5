"""What a simulated rater looks for in a team.

A criterion of a team is a callable `rows [..., R, F + V] -> score [...]`: both robots
side by side, each with what it sees of the other.

Shapes: R = 2 robots, F + V columns of a row.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from data.episodes.team_rows import sight_column
from data.errors import GaitprefError
from data.features import column
from gaitpref.raters.criteria import (
    BUILT_IN,
    CriterionContext,
    SequenceCriterion,
    load_criterion,
)

FORMATION = "formation"
_GAP_M = 0.8

TeamCriterion = Callable[[Tensor], Tensor]


def formation(rows: Tensor) -> Tensor:
    """Walk side by side 0.8 m apart, turn together, and do what both are told; in units
    per second, higher is better."""
    ahead, left = rows[..., sight_column("mate_pos_h")].unbind(-1)
    apart = (left.abs() - _GAP_M).abs() + ahead.abs()
    turned = 1 - rows[..., sight_column("mate_turned")][..., 0]
    return -(apart + 2 * turned + _not_followed(rows)).mean(dim=-1)


def _not_followed(rows: Tensor) -> Tensor:
    """How far each robot is from what it is told, [..., R]."""
    told = rows[..., column("command")]
    planar = told[..., :2] - rows[..., column("base_lin_vel_b")][..., :2]
    yaw = told[..., 2] - rows[..., column("base_ang_vel_b")][..., 2]
    return torch.linalg.vector_norm(planar, dim=-1) + 0.5 * yaw.abs()


def team_criterion(name: str, context: CriterionContext) -> TeamCriterion:
    """The criterion called `name`: `formation`, or one of a robot alone, of which a
    team gets the mean of both.

    Raises:
        GaitprefError: there is none, or it looks at more than one moment.
    """
    if name == FORMATION:
        return formation
    if name not in BUILT_IN and ":" not in name:
        known = ", ".join((FORMATION, *BUILT_IN))
        raise GaitprefError(
            f"no criterion of a team is called {name!r}; take {known}, or your own as "
            "package.module:function"
        )
    found = load_criterion(name, context)
    if isinstance(found, SequenceCriterion):
        raise GaitprefError(
            f"{name} looks at a rhythm over time, a criterion of a team at each moment "
            "by itself: take another"
        )
    alone = found
    return lambda rows: alone(rows).mean(dim=-1)
