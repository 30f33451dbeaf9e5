"""The feature rows of states that somebody else recorded.

Shapes: N states, F columns of the feature row.
"""

from __future__ import annotations

import mujoco
import numpy as np

from data.episodes.resample import conjugate, rotate
from data.features import FEATURE_DIM, column
from policy.robots.robot import Robot

_GROUND_PERCENTILE = 35.0
"""Percentile of the height of the lowest foot: there is the ground. Lower ones are feet
that land and sink in, higher ones a robot in flight."""


def feet_of(
    robot: Robot, qpos: np.ndarray, qvel: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the feet are in the states `qpos` [N, 19], `qvel` [N, 18].

    Returns:
        Positions [N, 4, 3] m and velocities [N, 4, 3] m/s of the foot sites, and
        turning rates [N, 4, 3] rad/s of the bodies that carry them, world frame.
    """
    mj_model, mj_data = robot.mj_model, mujoco.MjData(robot.mj_model)
    found = np.empty((3, len(qpos), 4, 3))
    along, about = np.zeros((2, 3, mj_model.nv))
    for row in range(len(qpos)):
        mj_data.qpos[:] = qpos[row]
        mujoco.mj_kinematics(mj_model, mj_data)
        mujoco.mj_comPos(mj_model, mj_data)
        for foot, site in enumerate(robot.foot_site_ids):
            mujoco.mj_jacSite(mj_model, mj_data, along, about, site)
            found[0, row, foot] = mj_data.site_xpos[site]
            found[1, row, foot] = along @ qvel[row]
            found[2, row, foot] = about @ qvel[row]
    return found[0], found[1], found[2]


def ground_below(foot_height: np.ndarray) -> float:
    """Height of a flat ground below feet whose lowest points are at [N, 4], m."""
    return float(np.percentile(foot_height.min(axis=1), _GROUND_PERCENTILE))


def rows_of(
    robot: Robot,
    qpos: np.ndarray,
    qvel: np.ndarray,
    *,
    dt_s: float,
    contact: np.ndarray | None,
    contact_height_m: float,
    torque: np.ndarray | None = None,
    action: np.ndarray | None = None,
    command: np.ndarray | None = None,
    foot_speed: np.ndarray | None = None,
    foot_height: np.ndarray | None = None,
) -> np.ndarray:
    """The feature rows [N, F] of states over a flat ground at height 0.

    Args:
        robot: Whose states they are.
        qpos: [N, 19], attitude of length 1.
        qvel: [N, 18].
        dt_s: Time between two states.
        contact: [N, 4] feet that touch; None: those below `contact_height_m`.
        contact_height_m: A lower foot touches.
        torque: [N, 12] N m; missing (NaN) without one.
        action: [N, 12]; missing without one.
        command: [N, 3]; missing without one.
        foot_speed: [N, 4] horizontal, where it was worked out before.
        foot_height: [N, 4] where it was worked out before.
    """
    if foot_speed is None or foot_height is None:
        positions, velocities, _ = feet_of(robot, qpos, qvel)
        foot_speed = np.linalg.norm(velocities[..., :2], axis=-1)
        foot_height = positions[..., 2] - robot.foot_radius
    touches = foot_height < contact_height_m if contact is None else contact
    back = conjugate(qpos[:, 3:7])
    down = np.broadcast_to([0.0, 0.0, -1.0], (len(qpos), 3))
    rows = np.full((len(qpos), FEATURE_DIM), np.nan)
    known = {
        "base_lin_vel_b": rotate(back, qvel[:, :3]),
        "base_ang_vel_b": qvel[:, 3:6],
        "gravity_b": rotate(back, down),
        "base_height": qpos[:, 2:3],
        "command": command,
        "joint_pos_offset": qpos[:, robot.qpos_adr] - robot.home_joint_pos,
        "joint_vel": qvel[:, robot.qvel_adr],
        "joint_torque": torque,
        "action": action,
        "action_rate": None if action is None else _rate(action),
        "foot_contact": touches,
        "foot_height": foot_height,
        "foot_speed": foot_speed,
        "foot_air_time": _air_time(touches, dt_s),
        "fallen": np.zeros((len(qpos), 1)),
    }
    for name, values in known.items():
        if values is not None:
            rows[:, column(name)] = values
    return rows


def _rate(action: np.ndarray) -> np.ndarray:
    """Each action less the one before; before the first, nobody knows."""
    return np.concatenate([np.full_like(action[:1], np.nan), np.diff(action, axis=0)])


def _air_time(contact: np.ndarray, dt_s: float) -> np.ndarray:
    """Seconds since lift-off [N, 4] of feet that touch where `contact` [N, 4] says."""
    times = np.zeros(contact.shape)
    for row in range(1, len(contact)):
        times[row] = np.where(contact[row], 0.0, times[row - 1] + dt_s)
    return times
