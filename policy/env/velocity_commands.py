"""Commands that suit a robot's size."""

from __future__ import annotations

from dataclasses import replace

from policy.robots.robot import Robot

from .env_cfg import CommandCfg, EnvCfg, Range
from .task_reward import size_of


def commands_for(robot: Robot, cfg: CommandCfg) -> CommandCfg:
    """`cfg`, which is meant for the robot that ships, for a robot of this size.

    Animals and robots of different size move alike at equal Froude numbers v^2 / (g L):
    speeds grow with the square root of the height, turning rates shrink with it.
    """
    faster = size_of(robot)[0] ** 0.5
    if faster == 1.0:
        return cfg
    return replace(
        cfg,
        forward_m_s=_times(cfg.forward_m_s, faster),
        left_m_s=_times(cfg.left_m_s, faster),
        yaw_rad_s=_times(cfg.yaw_rad_s, 1 / faster),
        evaluated_m_s=_times(cfg.evaluated_m_s, faster),
    )


def env_for(robot: Robot, cfg: EnvCfg) -> EnvCfg:
    """`cfg` with commands for a robot of this size; nothing else changes."""
    return replace(cfg, commands=commands_for(robot, cfg.commands))


def _times(interval: Range, factor: float) -> Range:
    low, high = interval
    # Two digits are what a person would have written.
    return round(low * factor, 2), round(high * factor, 2)
