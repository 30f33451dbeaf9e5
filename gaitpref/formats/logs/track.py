"""A stretch of a log at the control rate, as states and feature rows.

What the log lacks is worked out where it can be (velocities from poses, contacts from
the height of the feet), and missing, NaN, where it cannot.

Shapes: N states, F columns of the feature row.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data.episodes.resample import (
    conjugate,
    hold,
    interpolate,
    local_attitude,
    local_fit,
    rotate,
)
from policy.robots.robot import Robot

from .feature_rows import feet_of, ground_below, rows_of
from .log_map import LogMap
from .recording import Recording, Series

_WINDOW_STEPS = 2.5
"""Half the window that velocities are taken over, in control steps."""
_COMMAND_DIGITS, _EXACT_DIGITS = 1, 3


@dataclass(frozen=True, eq=False)
class Track:
    """A stretch of a log at the control rate."""

    qpos: np.ndarray
    """[N, 19]"""
    qvel: np.ndarray
    """[N, 18]"""
    rows: np.ndarray
    """[N, F] feature rows, NaN where missing."""
    command: tuple[float, float, float]
    derived: tuple[str, ...]
    """Features that were worked out from others."""
    estimated: tuple[str, ...]
    """Features that were estimated."""


def track_of(
    recording: Recording, log_map: LogMap, robot: Robot, grid_s: np.ndarray
) -> Track:
    """The states at the times `grid_s` [N], in which joints and base are known."""
    half_s = _WINDOW_STEPS * log_map.control_dt_s
    gap_s, start_s, stop_s = log_map.max_gap_s, grid_s[0], grid_s[-1]
    derived: list[str] = []
    place, turn = recording.base_pos_w, recording.base_wxyz
    assert place is not None
    assert turn is not None

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

    joints, place, turn = around(recording.joint_pos), around(place), around(turn)
    joint_pos, joint_rate = local_fit(joints.times_s, joints.values, grid_s, half_s)
    joint_vel = known_or("joint_vel", recording.joint_vel, joint_rate)
    base_pos, base_rate_w = local_fit(place.times_s, place.values, grid_s, half_s)
    wxyz, turn_rate = local_attitude(turn.times_s, turn.values, grid_s, half_s)
    rate_b = rotate(conjugate(wxyz), base_rate_w)
    lin_vel_b = known_or("base_lin_vel_b", recording.base_lin_vel_b, rate_b)
    ang_vel_b = known_or("base_ang_vel_b", recording.base_ang_vel_b, turn_rate)
    qpos = np.tile(robot.home_qpos, (len(grid_s), 1))
    qpos[:, :3], qpos[:, 3:7] = base_pos, wxyz
    qpos[:, robot.qpos_adr] = joint_pos
    qvel = np.zeros((len(grid_s), 18))
    qvel[:, :3], qvel[:, 3:6] = rotate(wxyz, lin_vel_b), ang_vel_b
    qvel[:, robot.qvel_adr] = joint_vel
    foot_pos_w, foot_vel_w, _ = feet_of(robot, qpos, qvel)
    foot_height = foot_pos_w[..., 2] - robot.foot_radius
    # An estimated height is above the feet already.
    if log_map.ground == "feet" and "base_height" not in recording.estimated:
        ground_m = ground_below(foot_height)
        foot_height = foot_height - ground_m
        qpos[:, 2] -= ground_m
    feet = known(recording.contact)
    if feet is None:
        derived.append("foot_contact")
    torque = known(recording.joint_torque)
    asked = _asked(recording, log_map, grid_s)
    rows = rows_of(
        robot,
        qpos,
        qvel,
        dt_s=log_map.control_dt_s,
        contact=None if feet is None else hold(feet.times_s, feet.values, grid_s) > 0.5,
        contact_height_m=log_map.contact_height_m,
        torque=torque and interpolate(torque.times_s, torque.values, grid_s),
        command=asked,
        foot_height=foot_height,
        foot_speed=np.linalg.norm(foot_vel_w[..., :2], axis=-1),
    )
    return Track(
        qpos=qpos,
        qvel=qvel,
        rows=rows,
        command=one_command(asked, lin_vel_b, ang_vel_b),
        derived=tuple(derived),
        estimated=recording.estimated,
    )


def _asked(
    recording: Recording, log_map: LogMap, grid_s: np.ndarray
) -> np.ndarray | None:
    """The command of every state [N, 3]; None where nobody knows it."""
    if log_map.command is not None:
        return np.tile(log_map.command, (len(grid_s), 1))
    told = recording.command
    return None if told is None else hold(told.times_s, told.values, grid_s)


def one_command(
    asked: np.ndarray | None, lin_vel_b: np.ndarray, ang_vel_b: np.ndarray
) -> tuple[float, float, float]:
    """What stands for the whole stretch, by which clips are paired.

    One that never changes is taken as it is; others are rounded, as is what the robot
    did where nobody asked.
    """
    digits = _COMMAND_DIGITS
    if asked is None:
        asked = np.column_stack([lin_vel_b[:, :2], ang_vel_b[:, 2]])
        forward, left, yaw = np.mean(asked, axis=0)
    else:
        forward, left, yaw = np.median(asked, axis=0)
        if np.ptp(asked, axis=0).max() < 10.0**-_EXACT_DIGITS:
            digits = _EXACT_DIGITS
    # Adding 0 turns -0.0 into 0.0, which is another text.
    first, second, third = (round(float(v), digits) + 0.0 for v in (forward, left, yaw))
    return first, second, third
