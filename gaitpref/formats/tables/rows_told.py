"""What the rows of a table say of a robot, with what cannot be true left out.

Shapes: N rows, S samples of a quantity.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields

import numpy as np

from data.episodes.resample import (
    conjugate,
    interpolate,
    interpolate_attitude,
    multiply,
    rotate,
)
from gaitpref.formats.logs.log_findings import Findings
from gaitpref.formats.logs.log_map import Columns, LogError, LogMap
from gaitpref.formats.logs.recording import (
    MIN_SAMPLES,
    Recording,
    Series,
    possible,
    unit_attitudes,
)
from policy.robots.robot import Robot

from .log_table import Table, columns_behind, named, picked

_SETTINGS = ("time_unit_s", "rate_hz", "quat_order", "contact_above")
"""Fields of `Columns` that name no column."""


def wanted_of(columns: Columns) -> set[str]:
    """Every column that a map names."""
    names = [
        name
        for field in fields(columns)
        if field.name not in _SETTINGS
        for name in named(getattr(columns, field.name))
    ]
    return columns_behind(names)


def recordings_of_table(
    table: Table, columns: Columns, log_map: LogMap, robot: Robot, findings: Findings
) -> list[Recording]:
    """What each run of the table's clock says, one for every episode in it.

    Raises:
        LogError: a column is missing or of another width, or nothing can be used.
    """
    rows = {name: len(values) for name, values in table.columns.items()}
    if len(set(rows.values())) > 1:
        told = ", ".join(f"{name[:60]} {count}" for name, count in rows.items())
        raise LogError(
            f"the columns of {table.name} must have a row for each moment, and are "
            f"of different lengths ({told[:300]}): cut them to the same moments"
        )
    times_s = _times(table, columns)
    if len(times_s) < MIN_SAMPLES:
        raise LogError(
            f"{table.name} has {len(times_s)} rows, {MIN_SAMPLES} are needed"
        )
    apart_s = float(np.nanmedian(np.abs(np.diff(times_s))))
    if apart_s > log_map.max_gap_s:
        raise LogError(
            f"the rows of {table.name} are {apart_s:g} s apart, more than max_gap_s; "
            "time_unit_s in [columns] says how many seconds the unit of time has"
        )
    numbers = _numbers(table, columns, log_map, robot)
    if "joint_pos" not in numbers:
        raise LogError(
            "[columns] of the map names no joint_pos and no qpos: say where the angles "
            "of the joints are"
        )
    whole = [
        _recording(times_s[part], {k: v[part] for k, v in numbers.items()}, findings)
        for part in _runs(table, columns, times_s, findings)
    ]
    found = [recording for recording in whole if recording is not None]
    if not found:
        raise LogError(
            f"{table.name} tells no {MIN_SAMPLES} angles of all joints and attitudes "
            f"of the base that can be used{findings.reasons('rows')}"
        )
    return found


def _times(table: Table, columns: Columns) -> np.ndarray:
    """When each row was taken [N], s; NaN where it does not say."""
    told = picked(table, columns.time, 1, "time")
    if told is not None:
        times_s = told[:, 0] * columns.time_unit_s
        return np.where(np.abs(times_s) < 1e12, times_s, np.nan)
    if columns.rate_hz is None:
        raise LogError(
            "[columns] of the map names no time; name that column, or say how many "
            "rows a second there are in rate_hz"
        )
    rows = max(map(len, table.columns.values()))
    return np.arange(rows) / columns.rate_hz


def _numbers(
    table: Table, columns: Columns, log_map: LogMap, robot: Robot
) -> dict[str, np.ndarray]:
    """Each quantity [N, D] that the map names, in our order and frames."""
    signs = np.array(log_map.joints.signs)

    def of(name: str, width: int) -> np.ndarray | None:
        return picked(table, getattr(columns, name), width, name)

    told = {
        "base_pos": of("base_pos", 3),
        "attitude": of("base_quat", 4),
        "lin_vel_b": of("base_lin_vel", 3),
        "ang_vel_b": of("base_ang_vel", 3),
        "gravity": of("gravity", 3),
        "joint_pos": of("joint_pos", 12),
        "joint_vel": of("joint_vel", 12),
        "torque": of("joint_torque", 12),
        "contact": of("contact", 4),
        "command": of("command", 3),
    }
    if columns.quat_order == "xyzw" and told["attitude"] is not None:
        told["attitude"] = told["attitude"][:, [3, 0, 1, 2]]
    if (qpos := of("qpos", 19)) is not None:
        told["base_pos"], told["attitude"] = qpos[:, :3], qpos[:, 3:7]
        told["joint_pos"] = qpos[:, robot.qpos_adr]
    if (qvel := of("qvel", 18)) is not None:
        told["lin_vel_w"], told["ang_vel_b"] = qvel[:, :3], qvel[:, 3:6]
        told["joint_vel"] = qvel[:, robot.qvel_adr]
    if (feet := told["contact"]) is not None:
        touches = (feet > columns.contact_above).astype(float)
        told["contact"] = np.where(np.isfinite(feet), touches, np.nan)
    for name in ("joint_pos", "joint_vel", "torque"):
        if (values := told[name]) is not None:
            told[name] = values * signs
    if (angles := told["joint_pos"]) is not None:
        told["joint_pos"] = angles + np.array(log_map.joints.offsets_rad)
    return {name: values for name, values in told.items() if values is not None}


def _runs(
    table: Table, columns: Columns, times_s: np.ndarray, findings: Findings
) -> Iterator[np.ndarray]:
    """The rows of each stretch in which time goes on, of one episode."""
    episode = picked(table, columns.episode, 1, "episode")
    rows = np.flatnonzero(np.isfinite(times_s))
    findings.leave_out("rows without a time", len(times_s) - len(rows))
    steps_s = np.diff(times_s[rows])
    apart = np.zeros(len(steps_s), dtype=bool)
    if episode is not None:
        told = np.nan_to_num(episode[rows, 0], nan=-1.0)
        apart = np.diff(told) != 0
    back = (steps_s < 0) & ~apart
    if back.any():
        findings.tell(
            f"time goes back, {int(back.sum())} times in all: each time, what follows "
            "is in episodes of its own"
        )
    same = np.concatenate([[False], (steps_s == 0) & ~apart])
    findings.leave_out("rows at the time of another", int(same.sum()))
    starts = np.flatnonzero(np.concatenate([[False], apart | back]))
    for part in np.split(np.arange(len(rows)), starts):
        yield rows[part[~same[part]]]


def _recording(
    times_s: np.ndarray, numbers: dict[str, np.ndarray], findings: Findings
) -> Recording | None:
    """What the rows of one run say; None where it is too little."""

    def series(name: str) -> Series | None:
        if name not in numbers:
            return None
        values = numbers[name]
        kept = possible(values)
        wrong = int((~kept).sum())
        findings.leave_out(f"rows whose {name} is no number that can be", wrong)
        return Series(times_s[kept], values[kept]) if kept.any() else None

    joints, turn = series("joint_pos"), series("ang_vel_b")
    attitude = _attitude(series("attitude"), series("gravity"), turn, findings)
    if attitude is None or joints is None:
        findings.leave_out("rows without joints or attitude", len(times_s))
        return None
    if min(len(joints.times_s), len(attitude.times_s)) < MIN_SAMPLES:
        findings.leave_out("rows in a run that is too short", len(times_s))
        return None
    velocity, in_world = series("lin_vel_b"), series("lin_vel_w")
    if in_world is not None:
        turned = interpolate_attitude(
            attitude.times_s, attitude.values, in_world.times_s
        )
        back = conjugate(turned)
        velocity = Series(in_world.times_s, rotate(back, in_world.values))
    place = series("base_pos")
    return Recording(
        joint_pos=joints,
        joint_vel=series("joint_vel"),
        joint_torque=series("torque"),
        base_pos_w=place if place and len(place.times_s) >= MIN_SAMPLES else None,
        base_wxyz=attitude,
        base_lin_vel_b=velocity,
        base_ang_vel_b=turn,
        contact=series("contact"),
        command=series("command"),
    )


def _attitude(
    told: Series | None, gravity: Series | None, turn: Series | None, findings: Findings
) -> Series | None:
    """Attitudes [S, 4] of length 1, out of what tells of them."""
    if told is not None:
        return unit_attitudes("rows whose", told, findings)
    return None if gravity is None else _from_gravity(gravity, turn)


def _from_gravity(gravity: Series, turn: Series | None) -> Series:
    """Roll and pitch from world down in the body, yaw from the gyroscope."""
    length = np.linalg.norm(gravity.values, axis=1, keepdims=True)
    up = -gravity.values / np.maximum(length, 1e-9)
    # The shortest turn that takes `up` to the vertical.
    turns = np.column_stack([1 + up[:, 2], up[:, 1], -up[:, 0], np.zeros(len(up))])
    tilt = turns / np.maximum(np.linalg.norm(turns, axis=1, keepdims=True), 1e-9)
    if turn is None:
        return Series(gravity.times_s, tilt)
    rates_w = rotate(tilt, interpolate(turn.times_s, turn.values, gravity.times_s))
    steps_s = np.diff(gravity.times_s, prepend=gravity.times_s[0])
    half = np.cumsum(rates_w[:, 2] * steps_s) / 2
    nothing = np.zeros(len(half))
    yaw = np.column_stack([np.cos(half), nothing, nothing, np.sin(half)])
    return Series(gravity.times_s, multiply(yaw, tilt))
