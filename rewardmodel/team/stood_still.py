"""What a team would look like had one of its robots stood still.

The difference to that is what the robot is worth to the team (Wolpert and Tumer 2002,
"Optimal payoff functions for members of collectives"; Foerster et al. 2018,
"Counterfactual multi-agent policy gradients", takes a mean over actions instead).
Nobody simulates the other world: from velocities and turning rates it is known where
the robot was a moment ago, and there it is put.

Shapes: T steps, E teams, R = 2 robots, F + V columns of a row.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from data.episodes.team_rows import sight_column
from data.features import column


@dataclass(frozen=True, kw_only=True)
class StandingCfg:
    """How a robot stands that does nothing."""

    height_m: float
    """Height of its base."""
    since_s: float = 1.0
    """For how long it has stood."""

    def steps(self, control_dt_s: float) -> int:
        """Control steps that it has stood."""
        return max(1, round(self.since_s / control_dt_s))


_AT_REST = (
    *("base_lin_vel_b", "base_ang_vel_b", "joint_pos_offset", "joint_vel", "action"),
    *("action_rate", "foot_height", "foot_speed", "foot_air_time", "fallen"),
)


def had_stood(
    rows: Tensor, starts: Tensor, robot: int, cfg: StandingCfg, *, control_dt_s: float
) -> Tensor:
    """Rows [T, E, R, F + V] in which `robot` stands where it was `cfg.since_s` ago, or
    where its episode, or what is known of it, began.

    Args:
        rows: Consecutive steps.
        starts: [T, E] bool, first steps of episodes.
        robot: Which of both, 0 or 1.
        cfg: How it stands.
        control_dt_s: Control step.
    """
    mate = 1 - robot
    moved, turned = _moved(rows[..., robot, :], starts, cfg, control_dt_s)
    seen = rows.clone()
    own = seen[..., robot, :]
    for name in _AT_REST:
        own[..., column(name)] = 0.0
    own[..., column("foot_contact")] = 1.0
    own[..., column("base_height")] = cfg.height_m
    level = own.new_tensor([0.0, 0.0, -1.0])
    own[..., column("gravity_b")] = level
    # As seen from where it stood: what lies between is there, and turned back.
    place = _turn(rows[..., robot, sight_column("mate_pos_h")] + moved, turned)
    c, s = rows[..., robot, sight_column("mate_turned")].unbind(-1)
    cos, sin = turned.cos(), turned.sin()
    angle = torch.stack([c * cos - s * sin, s * cos + c * sin], dim=-1)
    mates_speed = _turn(
        rows[..., robot, sight_column("mate_vel_h")]
        + _level_velocity(rows[..., robot, :]),
        turned,
    )
    own[..., sight_column("mate_pos_h")] = place
    own[..., sight_column("mate_turned")] = angle
    own[..., sight_column("mate_vel_h")] = mates_speed
    # And as the other sees it: the way back, in its own frame.
    other = seen[..., mate, :]
    other[..., sight_column("mate_pos_h")] = _turn_by(-place, angle)
    other[..., sight_column("mate_turned")] = angle * angle.new_tensor([1.0, -1.0])
    other[..., sight_column("mate_vel_h")] = _turn_by(-mates_speed, angle)
    return seen


def _moved(
    own: Tensor, starts: Tensor, cfg: StandingCfg, control_dt_s: float
) -> tuple[Tensor, Tensor]:
    """How far a robot has come and turned since then, [T, E, 2] in its own frame and
    [T, E] rad."""
    steps = cfg.steps(control_dt_s)
    turning = own[..., column("base_ang_vel_b")][..., 2] * control_dt_s
    heading = turning.cumsum(dim=0)
    # What was gone in a step of another episode is never counted: see `since`.
    gone = _turn(_level_velocity(own) * control_dt_s, heading).cumsum(dim=0)
    time = torch.arange(len(own), device=own.device)[:, None].expand(starts.shape)
    began = torch.where(starts, time, 0).cummax(dim=0).values
    since = torch.maximum(time - steps, began)
    then_gone = gone.gather(0, since[..., None].expand(*since.shape, 2))
    then_heading = heading.gather(0, since)
    return _turn(gone - then_gone, -heading), heading - then_heading


def _level_velocity(own: Tensor) -> Tensor:
    """Velocity [..., 2] of the base, ahead and to the left on the level, of rows
    [..., F + V] whose bases lean."""
    up = -own[..., column("gravity_b")]
    speed = own[..., column("base_lin_vel_b")]
    flat = speed - (speed * up).sum(dim=-1, keepdim=True) * up
    # The nose on the level, and what is to the left of it.
    nose = torch.zeros_like(up)
    nose[..., 0] = 1.0
    nose = torch.nn.functional.normalize(
        nose - (nose * up).sum(dim=-1, keepdim=True) * up, dim=-1
    )
    left = torch.linalg.cross(up, nose)
    return torch.stack([(flat * nose).sum(dim=-1), (flat * left).sum(dim=-1)], dim=-1)


def _turn(vectors: Tensor, angle: Tensor) -> Tensor:
    """Vectors [..., 2] turned by angles [...], rad."""
    return _by(vectors, angle.cos(), angle.sin())


def _turn_by(vectors: Tensor, turned: Tensor) -> Tensor:
    """Vectors [..., 2] of one frame in one that is turned by cosine, sine [..., 2]."""
    c, s = turned.unbind(-1)
    return _by(vectors, c, -s)


def _by(vectors: Tensor, c: Tensor, s: Tensor) -> Tensor:
    x, y = vectors.unbind(-1)
    return torch.stack([c * x - s * y, s * x + c * y], dim=-1)
