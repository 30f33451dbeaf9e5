"""Where the base is, by the legs that stand: for logs without an odometry.

A foot that stands rolls but does not slide, so the base moves against it as its leg
turns (the measurement of Bloesch et al. 2012, "State Estimation for Legged Robots",
without their filter). Heights are over flat ground at the feet. All of it is an
estimate: places drift, a foot that slips is taken for a robot that moves, and the bob
of a trot is too small to be seen.

Shapes: N samples, 4 feet.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from data.episodes.resample import (
    conjugate,
    hold,
    interpolate,
    interpolate_attitude,
    local_attitude,
    local_fit,
    rotate,
)
from policy.robots.robot import Robot

from .feature_rows import feet_of
from .log_findings import Findings
from .log_map import LogError, LogMap
from .recording import MIN_SAMPLES, Recording, Series

ESTIMATED = ("base_lin_vel_b", "base_height")
"""Features that come from it."""
_STANDS_M = 0.015
"""A foot this much above the lowest one counts a third of it in the velocity."""
_BEARS_M = 0.01
"""The same in the height."""
_SINKS_M_S = 0.3
"""A foot whose leg says that the base rises faster than it does by this much counts a
third: it swings or lands."""
_SLIPS_M_S = 0.2
"""The same along the ground, against what all feet say together."""
_ROUNDS = 3
_WINDOW_SAMPLES = 2.5
"""Half the window that rates are taken over, in samples."""
_SMOOTH_S = 0.1
"""Half the window of the cubics through velocity and height."""
_SMOOTH_RISE_S = 0.2
"""The same for the rate of the height."""


@dataclass(frozen=True, eq=False)
class LegOdometry:
    """What the legs say of the base."""

    height: np.ndarray
    """[N] m above the ground"""
    lin_vel_w: np.ndarray
    """[N, 3] m/s"""


def leg_odometry(
    robot: Robot,
    times_s: np.ndarray,
    wxyz: np.ndarray,
    ang_vel_b: np.ndarray,
    joint_pos: np.ndarray,
    joint_vel: np.ndarray,
    contact: np.ndarray | None = None,
) -> LegOdometry:
    """Height and velocity of the base, estimated.

    Args:
        robot: Whose legs they are.
        times_s: [N], rising.
        wxyz: [N, 4] attitude of the base.
        ang_vel_b: [N, 3] rad/s.
        joint_pos: [N, 12] rad.
        joint_vel: [N, 12] rad/s.
        contact: [N, 4] feet that touch, where it was measured; else those count that
            are low and agree.
    """
    qpos = np.tile(robot.home_qpos, (len(times_s), 1))
    qpos[:, :3], qpos[:, 3:7], qpos[:, robot.qpos_adr] = 0.0, wxyz, joint_pos
    qvel = np.zeros((len(times_s), robot.mj_model.nv))
    qvel[:, 3:6], qvel[:, robot.qvel_adr] = ang_vel_b, joint_vel
    place, speed, turn = feet_of(robot, qpos, qvel)
    # The centre of a round foot that rolls moves over the point that stands.
    up = robot.foot_radius[:, None] * np.array([0.0, 0.0, 1.0])
    of_base = np.cross(turn, np.broadcast_to(up, turn.shape)) - speed
    low = place[..., 2] - robot.foot_radius
    above = low - low.min(axis=1, keepdims=True)
    bears = np.exp(-above / _BEARS_M)
    height = -(bears * low).sum(axis=1) / bears.sum(axis=1)
    rise = _fit(times_s, height, _SMOOTH_S)[1]
    stands = np.exp(-above / _STANDS_M)
    stands *= np.exp(-np.abs(of_base[..., 2] - rise) / _SINKS_M_S)
    if contact is not None:
        # Where no foot is said to touch, the low ones still count.
        stands *= np.where(contact.any(axis=1, keepdims=True), contact + 1e-6, 1.0)
    velocity = _agreed(of_base[..., :2], stands)
    smooth = local_fit(times_s, velocity, times_s, _SMOOTH_S)[0]
    slow_rise = _fit(times_s, height, _SMOOTH_RISE_S)[1]
    return LegOdometry(
        height=_fit(times_s, height, _SMOOTH_S)[0][:, 0],
        lin_vel_w=np.concatenate([smooth, slow_rise], axis=1),
    )


def _agreed(velocities: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """What feet [N, 4] with `weights` say together of the velocity [N, 4, 2]."""
    counts = weights
    agreed = np.zeros_like(velocities[:, 0])
    for _ in range(_ROUNDS):
        total = counts.sum(axis=1, keepdims=True)
        agreed = (counts[..., None] * velocities).sum(axis=1) / total
        apart = np.linalg.norm(velocities - agreed[:, None], axis=-1)
        # The nearest foot keeps its weight, however far it is.
        nearest = apart.min(axis=1, keepdims=True)
        counts = weights * np.exp(-(apart - nearest) / _SLIPS_M_S)
    return agreed


def _fit(
    times_s: np.ndarray, values: np.ndarray, half_s: float
) -> tuple[np.ndarray, np.ndarray]:
    return local_fit(times_s, values[:, None], times_s, half_s)


def with_base_from_legs(
    recording: Recording, log_map: LogMap, robot: Robot, findings: Findings
) -> Recording:
    """`recording` with place, attitude and velocity of the base at its joints' times.

    Raises:
        LogError: it lacks the attitude of the base.
    """
    attitude = recording.base_wxyz
    if attitude is None or len(attitude.times_s) < MIN_SAMPLES:
        raise LogError(
            "the log tells no place of the base, and no attitude with which the legs "
            "could tell it; name an odometry in [base] of the map, or an IMU that "
            "gives its attitude in [imu]"
        )
    turn = recording.base_ang_vel_b or _turning(attitude)
    joints = _thinned(recording.joint_pos, log_map.control_dt_s / 2)
    times_s, joint_pos = _within(joints, attitude, turn, log_map.max_gap_s)
    if len(times_s) < MIN_SAMPLES:
        raise LogError(
            "joints and IMU are never known at once; are their stamps of one clock? "
            'time = "log" in the map takes the recorder\'s'
        )
    wxyz = interpolate_attitude(attitude.times_s, attitude.values, times_s)
    feet = recording.contact
    found = leg_odometry(
        robot,
        times_s,
        wxyz,
        interpolate(turn.times_s, turn.values, times_s),
        joint_pos,
        _joint_vel(recording, times_s),
        None if feet is None else hold(feet.times_s, feet.values, times_s) > 0.5,
    )
    told = recording.base_lin_vel_b
    velocity_w = found.lin_vel_w
    if told is not None:
        told_b = interpolate(told.times_s, told.values, times_s)
        velocity_w = rotate(wxyz, told_b)
    moved = (velocity_w[1:, :2] + velocity_w[:-1, :2]) / 2 * np.diff(times_s)[:, None]
    place = np.column_stack([np.zeros((len(times_s), 2)), found.height])
    place[1:, :2] = np.cumsum(moved, axis=0)
    findings.tell(
        "nothing tells where the base is: height"
        + (" and velocity" if told is None else "")
        + " are estimated from the legs that stand and the attitude of the IMU, over "
        "flat ground"
    )
    velocity_b = rotate(conjugate(wxyz), found.lin_vel_w)
    return replace(
        recording,
        base_pos_w=Series(times_s, place),
        base_wxyz=Series(times_s, wxyz),
        base_lin_vel_b=told or Series(times_s, velocity_b),
        estimated=ESTIMATED if told is None else ESTIMATED[1:],
    )


def _turning(attitude: Series) -> Series:
    """Turning rates [S, 3] of the base, out of its attitudes."""
    times_s = attitude.times_s
    half_s = _WINDOW_SAMPLES * float(np.median(np.diff(times_s)))
    rates = local_attitude(times_s, attitude.values, times_s, half_s)[1]
    return Series(times_s, rates)


def _thinned(series: Series, apart_s: float) -> Series:
    """Of samples nearer to each other than `apart_s`, the first."""
    chosen = [0]
    for index, time_s in enumerate(series.times_s.tolist()):
        if time_s - series.times_s[chosen[-1]] >= apart_s:
            chosen.append(index)
    return Series(series.times_s[chosen], series.values[chosen])


def _within(
    joints: Series, attitude: Series, turn: Series, max_gap_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Times [N] and angles [N, 12] of the joints while the IMU is known too."""
    times_s = joints.times_s
    known = np.ones(len(times_s), dtype=bool)
    for series in (attitude, turn):
        after = np.searchsorted(series.times_s, times_s)
        inside = (after > 0) & (after < len(series.times_s))
        here = np.clip(after, 1, len(series.times_s) - 1)
        gap_s = series.times_s[here] - series.times_s[here - 1]
        exact = series.times_s[np.minimum(after, len(series.times_s) - 1)] == times_s
        known &= (inside & (gap_s <= max_gap_s)) | exact
    return times_s[known], joints.values[known]


def _joint_vel(recording: Recording, times_s: np.ndarray) -> np.ndarray:
    told = recording.joint_vel
    if told is not None:
        return interpolate(told.times_s, told.values, times_s)
    joints = recording.joint_pos
    half_s = _WINDOW_SAMPLES * float(np.median(np.diff(joints.times_s)))
    return local_fit(joints.times_s, joints.values, times_s, half_s)[1]
