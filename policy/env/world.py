"""Robots as an environment simulates them."""

from __future__ import annotations

from policy.robots.robot import Robot

from .course import on_course
from .env_cfg import EnvCfg
from .getup import with_solid_legs
from .terrain import on_terrain


def in_world(robot: Robot, cfg: EnvCfg) -> Robot:
    """`robot` on the ground of `cfg`, and fit to lie on it where it has to.

    One that was made so before stays as it is. On flat ground, walking, so does any.
    """
    if cfg.getup is not None:
        robot = with_solid_legs(robot)
    if cfg.course is not None:
        return on_course(robot, cfg.course)
    return on_terrain(robot, cfg.terrain)
