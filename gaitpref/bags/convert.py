"""From the samples of a bag to episodes at the control rate.

What the bag lacks is worked out where it can be (velocities from poses, contacts from
the height of the feet), and missing, NaN, where it cannot.

Shapes: N states of an episode, T steps (N - 1), F columns of the feature row.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from data.episode import Episode, EpisodeMeta
from data.features import FEATURE_DIM, column, missing_features
from data.files import sha256_file
from data.resample import (
    conjugate,
    hold,
    interpolate,
    local_attitude,
    local_fit,
    overlaps,
    rotate,
    split_at_gaps,
)
from policy.robot import Robot, load_robot

from .bag_map import BagError, BagMap
from .read import Bag, Series, read_bag

_WINDOW_STEPS = 2.5
"""Half the window that velocities are taken over, in control steps."""
_GROUND_PERCENTILE = 5.0
"""Of the height of the lowest foot: there is the ground."""
_COMMAND_DIGITS = 1


def bag_episodes(bag_file: Path, bag_map: BagMap, root: Path) -> Iterator[Episode]:
    """Every stretch of a bag in which joints and base are known.

    Args:
        bag_file: The bag.
        bag_map: What its topics mean.
        root: Directory the map's paths start from.

    Raises:
        BagError, RobotError: the bag, its map or the robot cannot be used.
    """
    bag = read_bag(bag_file, bag_map)
    xml = None if bag_map.robot is None else root / bag_map.robot
    robot = load_robot(xml, physics_dt_s=bag_map.control_dt_s)
    if robot.mj_model.nq != 19:
        raise BagError(f"{robot.name} has more to it than a base and twelve joints")
    source = {
        "source": "ros2",
        "bag": bag_file.name,
        "bag_sha256": sha256_file(bag_file),
    }
    number = 0
    for start_s, stop_s in _stretches(bag, bag_map):
        grid_s = np.arange(start_s, stop_s, bag_map.control_dt_s)
        if len(grid_s) < 2:
            continue
        track = _track(bag, bag_map, robot, grid_s)
        for part in _parts(len(grid_s), bag_map):
            yield _episode(track, part, bag_map, robot, source, number)
            number += 1
    if number == 0:
        raise BagError(
            f"{bag_file} has no {bag_map.min_episode_s} s in which joints and base are "
            f"both known without a gap of {bag_map.max_gap_s} s"
        )


def _stretches(bag: Bag, bag_map: BagMap) -> list[tuple[float, float]]:
    known = overlaps(
        split_at_gaps(bag.joint_pos.times_s, bag_map.max_gap_s),
        split_at_gaps(bag.base_pos_w.times_s, bag_map.max_gap_s),
    )
    return [(a, b) for a, b in known if b - a >= bag_map.min_episode_s]


def _parts(num_states: int, bag_map: BagMap) -> Iterator[slice]:
    """States of each episode; one ends with the state the next begins with."""
    length = max(1, round(bag_map.episode_s * bag_map.control_hz))
    shortest = max(1, round(bag_map.min_episode_s * bag_map.control_hz))
    for first in range(0, num_states - 1, length):
        stop = min(first + length, num_states - 1)
        if stop - first >= min(shortest, num_states - 1):
            yield slice(first, stop + 1)


@dataclass(frozen=True, eq=False)
class _Track:
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


def _track(bag: Bag, bag_map: BagMap, robot: Robot, grid_s: np.ndarray) -> _Track:
    half_s = _WINDOW_STEPS * bag_map.control_dt_s
    derived: list[str] = []

    def known_or(
        name: str, series: Series | None, worked_out: np.ndarray
    ) -> np.ndarray:
        if series is not None:
            return interpolate(series.times_s, series.values, grid_s)
        derived.append(name)
        return worked_out

    joints = bag.joint_pos
    joint_pos, joint_rate = local_fit(joints.times_s, joints.values, grid_s, half_s)
    joint_vel = known_or("joint_vel", bag.joint_vel, joint_rate)
    place = bag.base_pos_w
    base_pos, base_rate_w = local_fit(place.times_s, place.values, grid_s, half_s)
    turn = bag.base_wxyz
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
    if bag.contact is None:
        derived.append("foot_contact")
        contact = foot_height < bag_map.contact_height_m
    else:
        contact = hold(bag.contact.times_s, bag.contact.values, grid_s) > 0.5
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
    if bag.joint_torque is not None:
        torque = bag.joint_torque
        rows[:, column("joint_torque")] = interpolate(
            torque.times_s, torque.values, grid_s
        )
    asked = _asked(bag, bag_map, grid_s)
    if asked is not None:
        rows[:, column("command")] = asked
    return _Track(
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


def _episode(
    track: _Track,
    part: slice,
    bag_map: BagMap,
    robot: Robot,
    source: dict[str, str],
    number: int,
) -> Episode:
    num_steps = part.stop - part.start - 1

    def unknown(*shape: int) -> np.ndarray:
        return np.full(shape, np.nan, dtype=np.float32)

    # A row tells what a step led to: that of the state behind it.
    rows = track.rows[part][1:].astype(np.float32)
    extra = source | {
        "derived_features": " ".join(track.derived),
        "missing_features": " ".join(missing_features(rows)),
    }
    return Episode(
        qpos=track.qpos[part].copy(),
        qvel=track.qvel[part].copy(),
        obs=unknown(num_steps + 1, 48),
        action=unknown(num_steps, 12),
        ctrl=unknown(num_steps, 12),
        features=rows,
        reward=unknown(num_steps),
        end_reason="truncated",
        meta=EpisodeMeta(
            task=bag_map.task,
            seed=0,
            env_index=number,
            command=track.command,
            policy_sha256=source["bag_sha256"],
            policy_step=0,
            stochastic=False,
            control_dt_s=bag_map.control_dt_s,
            physics_dt_s=bag_map.control_dt_s,
            robot=robot.name,
            model_sha256=robot.model_sha256,
            extra=extra,
        ),
        mjcf=robot.mjcf,
    )
