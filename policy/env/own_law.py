"""The law of this project's own policies, as the record that others have too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from data.features import JOINTS
from policy.law.law import Law, Term, Vector
from policy.robots.robot import Robot

from .env_cfg import EnvCfg

OWN_TERMS = (
    "base_lin_vel",
    "base_ang_vel",
    "projected_gravity",
    "joint_pos",
    "joint_vel",
    "last_action",
    "command",
)
"""What a policy of this project sees, in its order."""
_FARTHEST_RAD = 100.0
"""Bound of a target where the model sets none."""


def own_law(robot: Robot, env: EnvCfg, *, joints: tuple[str, ...] = JOINTS) -> Law:
    """The law of a policy for `robot` in `env` that begins at home and keeps to its
    joints' ranges, with the gains of its servos."""
    order = [JOINTS.index(joint) for joint in joints]

    def vector(values: np.ndarray) -> Vector:
        return tuple(float(value) for value in values[order])

    home = vector(robot.home_joint_pos)
    limits = robot.torque_limit
    bounds = robot.joint_range.clip(-_FARTHEST_RAD, _FARTHEST_RAD)[order]
    return Law(
        terms=tuple(Term(name=name) for name in OWN_TERMS),
        joints=joints,
        default_joint_pos_rad=home,
        action_scale_rad=(env.action_scale_rad,) * 12,
        action_offset_rad=home,
        action_limit=env.action_limit,
        target_clip_rad=tuple((float(low), float(high)) for low, high in bounds),
        kp_nm_per_rad=vector(robot.kp),
        kd_nm_s_per_rad=vector(robot.kd),
        torque_limit_nm=vector(limits) if np.isfinite(limits).all() else None,
        physics_dt_s=env.physics_dt_s,
        substeps=env.substeps,
    )


def imu_law(robot: Robot, env: EnvCfg, *, frames: int) -> Law:
    """The law of a policy that sees what a robot measures: all but the velocity of the
    base, of `frames` control steps."""
    seen = (name for name in OWN_TERMS if name != "base_lin_vel")
    terms = tuple(Term(name=name, frames=frames) for name in seen)
    return replace(own_law(robot, env), terms=terms)
