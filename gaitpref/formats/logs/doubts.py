"""Signs that a bag does not tell of one robot's motion.

Shapes: S samples, N states, D columns.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from data.features import JOINTS
from policy.robots.robot import Robot

from .log_findings import Findings
from .log_map import LogError

FASTEST_RAD_S = 30.0
"""No joint of a legged robot of our size turns faster; a Go1's reach 30.1 rad/s."""
FASTEST_M_S = 10.0
"""No quadruped runs faster."""
BEYOND_RAD = 0.2
"""Limits of a model may be off by this much."""
_JUMP = 0.05
"""rad or m: less may be noise."""
_JUMP_RATIO = 4.0
"""A sample jumps if it is this much farther from both neighbours than they are from
each other."""
_JUMPING_SHARE = 0.05
_RATE_HZ = 30.0
"""Rate of samples below which a gait itself looks as if it jumped."""


def refuse_two_publishers(
    topic: str, times_s: np.ndarray, values: np.ndarray, unit: str
) -> None:
    """Refuse values [S, D] that go to and fro from one sample to the next.

    Raises:
        LogError: more than a twentieth of them do.
    """
    if len(times_s) < 20 or np.median(np.diff(times_s)) > 1 / _RATE_HZ:
        return
    before, here, after = values[:-2], values[1:-1], values[2:]
    away = np.abs(here - (before + after) / 2).max(axis=1)
    apart = np.abs(after - before).max(axis=1)
    jumps = (away > _JUMP) & (away > _JUMP_RATIO * apart)
    if jumps.mean() > _JUMPING_SHARE:
        raise LogError(
            f"{topic} goes to and fro: {int(jumps.sum())} of {len(values)} samples "
            f"jump by up to {away[jumps].max():.2g} {unit} away from those before and "
            "after, as if two publishers wrote on it; record it with one of them"
        )


def tell_of_speed(
    tracks: Iterable[tuple[np.ndarray, np.ndarray]],
    base_speed_m_s: Iterable[np.ndarray],
    findings: Findings,
) -> None:
    """Tell of joints or a base that are faster than a robot.

    Args:
        tracks: Angles and velocities [N, 12] of the joints, stretch by stretch.
        base_speed_m_s: [N] of the base, stretch by stretch.
        findings: Told.
    """
    fastest = jump = 0.0
    for joint_pos, joint_vel in tracks:
        fastest = max(fastest, float(np.abs(joint_vel).max()))
        jump = max(jump, float(np.abs(np.diff(joint_pos, axis=0)).max()))
    if fastest > FASTEST_RAD_S:
        findings.tell(
            f"joint_vel up to {fastest:.3g} rad/s, joints jump by {jump:.2g} rad a "
            f"step: legs of this size turn at {FASTEST_RAD_S:.0f} rad/s at most; are "
            "there two publishers on the topic, or wrong stamps?"
        )
    base = max((float(speed.max()) for speed in base_speed_m_s), default=0.0)
    if base > FASTEST_M_S:
        findings.tell(
            f"the base moves at up to {base:.3g} m/s: no quadruped does; does its "
            "topic jump, or have wrong stamps?"
        )


def tell_of_range(
    joint_pos: Iterable[np.ndarray], robot: Robot, findings: Findings
) -> None:
    """Tell of joints that go where those of `robot` cannot."""
    every = np.concatenate(list(joint_pos))
    low, high = every.min(axis=0), every.max(axis=0)
    beyond = np.maximum(robot.joint_range[:, 0] - low, high - robot.joint_range[:, 1])
    worst = int(beyond.argmax())
    if beyond[worst] > BEYOND_RAD:
        first, last = robot.joint_range[worst]
        findings.tell(
            f"{JOINTS[worst]} goes from {low[worst]:.2f} to {high[worst]:.2f} rad, "
            f"that of {robot.name} from {first:.2f} to {last:.2f}: is it the robot, "
            "are the names, signs and offsets_rad of the map right, are angles in rad?"
        )
