"""Whether a policy walks: for each command, and from rest.

A mean over commands hides robots that stand: one that never sets off at 0.3 m/s misses
the command by less than many a walk. A real robot begins at home and at rest.

Shapes: T steps, N episodes, F feature columns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from data.features import column
from data.files.telling import Tell, silent
from policy.env.env_cfg import EnvCfg, ResetCfg
from policy.robots.robot import Robot

from .evaluate import GRID_SPEEDS, rollout_features
from .rollout import Actor

SETTLED_S = 2.0
"""What comes before in an episode is the start of a walk."""
SET_OFF = 0.25
"""Share of the speed asked for, below which a robot has not set off."""
TRACKING_ERROR_M_S = 0.20
"""Largest mean distance between velocity and command of what follows it."""
AT_REST = ResetCfg(
    joint_pos_rad=0.0,
    joint_vel_rad_s=0.0,
    base_lin_vel_m_s=0.0,
    base_ang_vel_rad_s=0.0,
    tilt_rad=0.0,
    height_m=0.0,
)
"""Every robot begins exactly at home, and does not move."""


@dataclass(frozen=True, kw_only=True)
class CommandWalk:
    """What one forward command led to."""

    asked_m_s: float
    episodes: int
    """Those whose simulation did not diverge."""
    speed_m_s: float | None
    """Mean forward speed once settled; None where all fell before."""
    tracking_error_m_s: float
    """Mean over all steps of the distance between planar velocity and command."""
    never_set_off: int
    """Robots that stood where they were."""
    falls: int

    @property
    def walks(self) -> bool:
        """Whether every robot set off, none fell, and together they follow."""
        return (
            self.episodes > 0
            and self.never_set_off == 0
            and self.falls == 0
            and self.tracking_error_m_s <= TRACKING_ERROR_M_S
        )


@dataclass(frozen=True, kw_only=True)
class Walking:
    """A policy over the grid of commands."""

    commands: tuple[CommandWalk, ...]
    """From starts with the noise of training, slowest first."""
    from_rest: tuple[CommandWalk, ...]
    """Exactly from home, where all robots of a command are alike."""

    @property
    def walks(self) -> bool:
        """Whether it walks for each command, and from rest."""
        return all(command.walks for command in (*self.commands, *self.from_rest))


def command_walks(
    features: Tensor, lengths: Tensor, *, control_dt_s: float
) -> tuple[CommandWalk, ...]:
    """What rows [T, N, F] of episodes with `lengths` [N] say of each forward command.

    A command of less than a crawl is left out: nobody has to set off for it.
    """
    asked = features[0, :, column("command")][:, 0]
    return tuple(
        _one(features[:, asked == speed], lengths[asked == speed], control_dt_s)
        for speed in asked[lengths > 0].unique().tolist()
        if abs(speed) >= 0.05
    )


def from_rest(
    actor: Actor, robot: Robot, cfg: EnvCfg, *, seed: int, tell: Tell = silent
) -> tuple[CommandWalk, ...]:
    """What comes of a start exactly at home, for each command of the grid; `tell` gets
    control steps."""
    at_rest = replace(cfg, reset=AT_REST)
    seen = rollout_features(
        actor, robot, at_rest, episodes=GRID_SPEEDS, seed=seed, tell=tell
    )
    return command_walks(*seen, control_dt_s=cfg.control_dt_s)


def walking(
    actor: Actor,
    robot: Robot,
    cfg: EnvCfg,
    features: Tensor,
    lengths: Tensor,
    *,
    seed: int,
    tell: Tell = silent,
) -> Walking:
    """How `actor` walks, by rows [T, N, F] of it over the grid, and from rest.

    Args:
        actor: Acts without exploration noise.
        robot: The robot.
        cfg: Where it acts.
        features: What `rollout_features` gave.
        lengths: [N], likewise.
        seed: Where the robots that begin at rest are, on uneven ground.
        tell: Gets the control steps from rest.
    """
    return Walking(
        commands=command_walks(features, lengths, control_dt_s=cfg.control_dt_s),
        from_rest=from_rest(actor, robot, cfg, seed=seed, tell=tell),
    )


def _one(features: Tensor, lengths: Tensor, control_dt_s: float) -> CommandWalk:
    """The episodes [T, N, F] of one command."""
    command = features[0, 0, column("command")]
    asked = float(command[0])
    steps = torch.arange(len(features))[:, None]
    valid = steps < lengths
    settled = valid & (steps * control_dt_s >= SETTLED_S)
    velocity = features[..., column("base_lin_vel_b")][..., :2]
    error = torch.linalg.vector_norm(velocity - command[:2], dim=-1)
    forward = velocity[..., 0]
    walked = settled.any(dim=0)
    speeds = (forward * settled).sum(dim=0)[walked] / settled.sum(dim=0)[walked]
    return CommandWalk(
        asked_m_s=round(asked, 3),
        episodes=int((lengths > 0).sum()),
        speed_m_s=float(speeds.mean()) if len(speeds) else None,
        tracking_error_m_s=float(error[valid].mean()),
        never_set_off=int((speeds / asked < SET_OFF).sum()),
        falls=int(features[..., column("fallen")].sum()),
    )


def table(walking: Walking) -> str:
    """`walking` in columns, for people."""
    rest = {command.asked_m_s: command for command in walking.from_rest}
    lines = ["asked      speed      error      falls   never set off   from rest"]
    for row in walking.commands:
        stood = f"{row.never_set_off} of {row.episodes}"
        lines.append(
            f"{row.asked_m_s:.2f} m/s  {_speed(row):9}  "
            f"{row.tracking_error_m_s:.2f} m/s  {row.falls:<7} {stood:15} "
            f"{_from_rest(rest.get(row.asked_m_s))}"
        )
    return "\n".join(lines)


def _from_rest(command: CommandWalk | None) -> str:
    if command is None or not command.episodes:
        return "diverged"
    if command.falls:
        return "FALLS"
    if command.never_set_off:
        return "STANDS"
    return _speed(command)


def _speed(command: CommandWalk) -> str:
    return "none" if command.speed_m_s is None else f"{command.speed_m_s:.2f} m/s"
