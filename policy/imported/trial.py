"""Does it walk? An imported policy on the robot, measured before anybody relies on it.

Shapes: N commands, T steps.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from data.features import column
from data.files.telling import Tell, silent
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import CommandCfg, EnvCfg, ResetCfg
from policy.law.origin import Measured
from policy.robots.robot import Robot
from policy.rollouts.rollout import Actor, first_episodes

ASKED: tuple[tuple[float, float, float], ...] = (
    (0.0, 0.0, 0.0),
    (0.5, 0.0, 0.0),
    (1.0, 0.0, 0.0),
    (0.0, 0.0, 0.5),
    (0.0, 0.0, 1.0),
)
STAND_S, WALK_S, SETTLING_S = 2.0, 10.0, 2.0
_AT_REST = ResetCfg(
    joint_pos_rad=0.0,
    joint_vel_rad_s=0.0,
    base_lin_vel_m_s=0.0,
    base_ang_vel_rad_s=0.0,
    tilt_rad=0.0,
    height_m=0.0,
)


def measure(
    actor: Actor,
    robot: Robot,
    cfg: EnvCfg,
    *,
    asked: tuple[tuple[float, float, float], ...] = ASKED,
    walk_s: float = WALK_S,
    tell: Tell = silent,
) -> tuple[Measured, ...]:
    """What `actor` does from rest, exactly at home, on flat ground without noise;
    `tell` gets control steps."""
    still = CommandCfg(resample_s=float("inf"))
    cfg = replace(cfg, reset=_AT_REST, episode_s=walk_s, commands=still)
    env = QuadrupedEnv(robot, cfg, len(asked), seed=0)
    env.fix_commands(torch.tensor(asked))
    columns = [
        *range(*column("base_lin_vel_b").indices(1000))[:2],
        range(*column("base_ang_vel_b").indices(1000))[2],
    ]
    moved: list[Tensor] = []
    fell_at: list[float | None] = [None] * len(asked)
    for done, step in enumerate(first_episodes(actor, env), start=1):
        tell(done, cfg.episode_steps)
        moved.append(torch.where(step.alive[:, None], step.features[:, columns], 0.0))
        for index in (step.fallen | step.aborted).nonzero().flatten().tolist():
            fell_at[index] = done * cfg.control_dt_s
    rows = torch.stack(moved)
    found = []
    for index, (command, fell) in enumerate(zip(asked, fell_at, strict=True)):
        seconds = walk_s if any(command) else STAND_S
        first = round((SETTLING_S if any(command) else 0.0) / cfg.control_dt_s)
        last = round((fell or seconds) / cfg.control_dt_s)
        part = rows[first:last, index] if last > first else rows[:last, index]
        late = fell is not None and fell > seconds
        forward, left, yaw = part.mean(dim=0).tolist()
        found.append(
            Measured(
                command=command,
                seconds=seconds,
                forward_m_s=forward,
                left_m_s=left,
                yaw_rad_s=yaw,
                fell_at_s=None if late else fell,
            )
        )
    return tuple(found)
