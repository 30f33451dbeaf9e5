"""Where in a simulator's arrays is what the environment reads and writes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data.features import LEGS
from policy.robots.robot import Robot

Columns = slice | np.ndarray
"""Columns of the last axis: a slice where they follow one another, which gives views
instead of copies."""


@dataclass(frozen=True, eq=False)
class Addresses:
    """Columns of one robot, in the order of joints and legs."""

    base_qpos: int
    """The first of the base: position, then attitude."""
    base_qvel: int
    """The first of the base: velocity, then turning rate."""
    qpos: Columns
    """12 angles in `qpos`."""
    qvel: Columns
    """12 velocities in `qvel`, or torques in `qfrc_actuator`."""
    ctrl: Columns
    """12 targets in `ctrl`."""
    sites: Columns
    """4 feet in `site_xpos`."""
    contact: Columns
    """4 feet in `sensordata`: contacts with the ground."""
    base_contact: int
    """The base in `sensordata`: contacts with the ground."""
    velocity: Columns
    """4 times 3 velocities of the feet in `sensordata`."""


def addresses_of(robot: Robot, prefix: str = "") -> Addresses:
    """The columns of `robot`, whose sensors have names that begin with `prefix`."""
    mj_model = robot.mj_model

    def sensor(name: str) -> int:
        return int(mj_model.sensor(f"{prefix}gaitpref_{name}").adr[0])

    joint = mj_model.body_jntadr[robot.base_body_id]
    velocity = [sensor(f"vel_{leg}") for leg in LEGS]
    return Addresses(
        base_qpos=int(mj_model.jnt_qposadr[joint]),
        base_qvel=int(mj_model.jnt_dofadr[joint]),
        qpos=_columns(robot.qpos_adr),
        qvel=_columns(robot.qvel_adr),
        ctrl=_columns(robot.actuator_ids),
        sites=_columns(robot.foot_site_ids),
        contact=_columns(np.array([sensor(f"contact_{leg}") for leg in LEGS])),
        base_contact=sensor("contact_base"),
        velocity=_columns(np.add.outer(velocity, np.arange(3)).ravel()),
    )


def _columns(ids: np.ndarray) -> Columns:
    first, count = int(ids[0]), len(ids)
    if (ids == np.arange(first, first + count)).all():
        return slice(first, first + count)
    return ids
