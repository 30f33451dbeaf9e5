"""The law of this project's own policies, as the record that others have too."""

from __future__ import annotations

import numpy as np

from data.features import JOINTS
from policy.robots.robot import Robot

from .law import Law, Term, Vector

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


def own_law(
    robot: Robot,
    *,
    action_scale_rad: float,
    action_limit: float,
    physics_dt_s: float,
    substeps: int,
    terms: tuple[Term, ...] = tuple(Term(name=name) for name in OWN_TERMS),
) -> Law:
    """The law of a policy for `robot` that begins at home and keeps to its joints'
    ranges, with the gains of its servos."""
    home = _vector(robot.home_joint_pos)
    limits = robot.torque_limit
    bounds = robot.joint_range.clip(-_FARTHEST_RAD, _FARTHEST_RAD)
    return Law(
        terms=terms,
        joints=JOINTS,
        default_joint_pos_rad=home,
        action_scale_rad=(action_scale_rad,) * 12,
        action_offset_rad=home,
        action_limit=action_limit,
        target_clip_rad=tuple((float(low), float(high)) for low, high in bounds),
        kp_nm_per_rad=_vector(robot.kp),
        kd_nm_s_per_rad=_vector(robot.kd),
        torque_limit_nm=_vector(limits) if np.isfinite(limits).all() else None,
        physics_dt_s=physics_dt_s,
        substeps=substeps,
    )


def _vector(values: np.ndarray) -> Vector:
    return tuple(float(value) for value in values)
