"""A stretch of a bag at the control rate, as states and feature rows.

What the bag lacks is worked out where it can be (velocities from poses, contacts from
the height of the feet), and missing, NaN, where it cannot.

Shapes: N states, F columns of the feature row.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from data.episodes.resample import (
    conjugate,
    hold,
    interpolate,
    local_attitude,
    local_fit,
    rotate,
)
from data.features import FEATURE_DIM, column
from policy.robots.robot import Robot

from .bag_map import BagMap
from .series import Bag, Series

_WINDOW_STEPS = 2.5
"""Half the window that velocities are taken over, in control steps."""
_GROUND_PERCENTILE = 5.0
"""Percentile of the height of the lowest foot: there is the ground."""
_COMMAND_DIGITS = 1


@dataclass(frozen=True, eq=False)
class Track:
    """A stretch of a bag at the control rate."""

    qpos: np.ndarray
    """[N, 19]"""
    qvel: np.ndarray
    """[N, 18]"""
    rows: np.ndarray
    """[N, F] feature rows, NaN where missing."""
    command: tuple[float, float, float]
    derived: tuple[str, ...]
    """Features that were worked out from others."""


def track_of(bag: Bag, bag_map: BagMap, robot: Robot, grid_s: np.ndarray) -> Track:
    """The states at the times `grid_s` [N], in which joints and base are known."""
    half_s = _WINDOW_STEPS * bag_map.control_dt_s
    gap_s, start_s, stop_s = bag_map.max_gap_s, grid_s[0], grid_s[-1]
    derived: list[str] = []

    def around(series: Series) -> Series:
        # Beyond a gap lies another stretch, of which this one knows nothing.
        return series.between(start_s - gap_s, stop_s + gap_s)

    def known(series: Series | None) -> Series | None:
        if series is None or not series.covers(start_s, stop_s, gap_s):
            return None
        return around(series)

    def known_or(
        name: str, series: Series | None, worked_out: np.ndarray
    ) -> np.ndarray:
        told = known(series)
        if told is not None:
            return interpolate(told.times_s, told.values, grid_s)
        derived.append(name)
        return worked_out

    joints = around(bag.joint_pos)
    joint_pos, joint_rate = local_fit(joints.times_s, joints.values, grid_s, half_s)
    joint_vel = known_or("joint_vel", bag.joint_vel, joint_rate)
    place = around(bag.base_pos_w)
    base_pos, base_rate_w = local_fit(place.times_s, place.values, grid_s, half_s)
    turn = around(bag.base_wxyz)
    wxyz, turn_rate = local_attitude(turn.times_s, turn.values, grid_s, half_s)
    back = conjugate(wxyz)
    lin_vel_b = known_or(
        "base_lin_vel_b", bag.base_lin_vel_b, rotate(back, base_rate_w)
    )
    ang_vel_b = known_or("base_ang_vel_b", bag.base_ang_vel_b, turn_rate)
    qpos = np.tile(robot.home_qpos, (len(grid_s), 1))
    qpos[:, :3], qpos[:, 3:7] = base_pos, wxyz
    qpos[:, robot.qpos_adr] = joint_pos
    qvel = np.zeros((len(grid_s), 18))
    qvel[:, :3], qvel[:, 3:6] = rotate(wxyz, lin_vel_b), ang_vel_b
    qvel[:, robot.qvel_adr] = joint_vel
    foot_pos_w, foot_vel_w = _feet(robot, qpos, qvel)
    foot_height = foot_pos_w[..., 2] - robot.foot_radius
    if bag_map.ground == "feet":
        ground_m = np.percentile(foot_height.min(axis=1), _GROUND_PERCENTILE)
        foot_height = foot_height - ground_m
        qpos[:, 2] -= ground_m
    feet = known(bag.contact)
    if feet is None:
        derived.append("foot_contact")
        contact = foot_height < bag_map.contact_height_m
    else:
        contact = hold(feet.times_s, feet.values, grid_s) > 0.5
    rows = np.full((len(grid_s), FEATURE_DIM), np.nan)
    down = np.broadcast_to([0.0, 0.0, -1.0], (len(grid_s), 3))
    for name, values in {
        "base_lin_vel_b": lin_vel_b,
        "base_ang_vel_b": ang_vel_b,
        "gravity_b": rotate(back, down),
        "base_height": qpos[:, 2:3],
        "joint_pos_offset": joint_pos - robot.home_joint_pos,
        "joint_vel": joint_vel,
        "foot_contact": contact,
        "foot_height": foot_height,
        "foot_speed": np.linalg.norm(foot_vel_w[..., :2], axis=-1),
        "foot_air_time": _air_time(contact, bag_map.control_dt_s),
        "fallen": np.zeros((len(grid_s), 1)),
    }.items():
        rows[:, column(name)] = values
    torque = known(bag.joint_torque)
    if torque is not None:
        rows[:, column("joint_torque")] = interpolate(
            torque.times_s, torque.values, grid_s
        )
    asked = _asked(bag, bag_map, grid_s)
    if asked is not None:
        rows[:, column("command")] = asked
    return Track(
        qpos=qpos,
        qvel=qvel,
        rows=rows,
        command=_one_command(asked, lin_vel_b, ang_vel_b),
        derived=tuple(derived),
    )


def _feet(
    robot: Robot, qpos: np.ndarray, qvel: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities of the feet, world frame, each [N, 4, 3]."""
    mj_model, mj_data = robot.mj_model, mujoco.MjData(robot.mj_model)
    positions, velocities = np.empty((2, len(qpos), 4, 3))
    jacobian = np.zeros((3, mj_model.nv))
    for row in range(len(qpos)):
        mj_data.qpos[:] = qpos[row]
        mujoco.mj_kinematics(mj_model, mj_data)
        mujoco.mj_comPos(mj_model, mj_data)
        for foot, site in enumerate(robot.foot_site_ids):
            mujoco.mj_jacSite(mj_model, mj_data, jacobian, None, site)
            positions[row, foot] = mj_data.site_xpos[site]
            velocities[row, foot] = jacobian @ qvel[row]
    return positions, velocities


def _air_time(contact: np.ndarray, dt_s: float) -> np.ndarray:
    """Seconds since lift-off [N, 4] of feet that touch where `contact` [N, 4] says."""
    times = np.zeros(contact.shape)
    for row in range(1, len(contact)):
        times[row] = np.where(contact[row], 0.0, times[row - 1] + dt_s)
    return times


def _asked(bag: Bag, bag_map: BagMap, grid_s: np.ndarray) -> np.ndarray | None:
    """The command of every state [N, 3]; None where nobody knows it."""
    if bag_map.command is not None:
        return np.tile(bag_map.command, (len(grid_s), 1))
    if bag.command is not None:
        return hold(bag.command.times_s, bag.command.values, grid_s)
    return None


def _one_command(
    asked: np.ndarray | None, lin_vel_b: np.ndarray, ang_vel_b: np.ndarray
) -> tuple[float, float, float]:
    """What stands for the whole stretch, by which clips are paired.

    Rounded, as the commands that are simulated are; without one, what the robot did.
    """
    if asked is None:
        asked = np.column_stack([lin_vel_b[:, :2], ang_vel_b[:, 2]])
        forward, left, yaw = np.mean(asked, axis=0)
    else:
        forward, left, yaw = np.median(asked, axis=0)
    # Adding 0 turns -0.0 into 0.0, which is another text.
    first, second, third = (
        round(float(v), _COMMAND_DIGITS) + 0.0 for v in (forward, left, yaw)
    )
    return first, second, third
