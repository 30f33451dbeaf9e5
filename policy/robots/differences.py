"""What another robot has that a policy was not trained for."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .robot import Robot

_SAME = 0.02
"""Relative difference that is none: of a unit rounded, of a mesh made coarser."""


def differences(trained: Robot, other: Robot) -> list[str]:
    """In what `other` is not `trained`, in words; empty where both move alike."""
    if trained.model_sha256 == other.model_sha256:
        return []
    found = [
        f"{name} {there:.3g} {unit} instead of {here:.3g}"
        for name, unit, of in _MEASURES
        if not np.isclose(here := of(trained), there := of(other), rtol=_SAME)
    ]
    pose_rad = np.abs(trained.home_joint_pos - other.home_joint_pos).max()
    if pose_rad > _SAME:
        found.append(f"a home pose that is up to {pose_rad:.2f} rad away")
    return found


def _mass_kg(robot: Robot) -> float:
    return float(robot.mj_model.body_subtreemass[robot.base_body_id])


_MEASURES: tuple[tuple[str, str, Callable[[Robot], float]], ...] = (
    ("a mass of", "kg", _mass_kg),
    ("a base at", "m", lambda robot: float(robot.home_qpos[2])),
    ("kp of", "N m/rad", lambda robot: float(robot.kp.mean())),
    ("kd of", "N m s/rad", lambda robot: float(robot.kd.mean())),
    ("torques of up to", "N m", lambda robot: float(robot.torque_limit.max())),
)
"""Name, unit and number of what decides how a robot moves."""
