"""What a log says of a robot: samples of each quantity over time.

Shapes: S samples of a quantity, D columns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .log_findings import Findings

MIN_SAMPLES = 6
"""Samples of joints and base, for a cubic through them."""
UNIT_TOLERANCE = 0.01
"""By how much the length of a quaternion may differ from 1: it is made 1."""
LARGEST = 1e9
"""No angle, speed, torque or place of a robot is larger, in whatever unit."""


@dataclass(frozen=True, eq=False)
class Series:
    """Samples of one quantity, in the order of time, no two at once."""

    times_s: np.ndarray
    """[S]"""
    values: np.ndarray
    """[S, D]"""

    def between(self, start_s: float, stop_s: float) -> Series:
        """The samples from `start_s` to `stop_s`."""
        first = np.searchsorted(self.times_s, start_s, side="left")
        last = np.searchsorted(self.times_s, stop_s, side="right")
        return Series(self.times_s[first:last], self.values[first:last])

    def covers(self, start_s: float, stop_s: float, max_gap_s: float) -> bool:
        """Whether there is no longer silence than `max_gap_s` in the stretch."""
        here = self.between(start_s - max_gap_s, stop_s + max_gap_s).times_s
        edges = np.concatenate([[start_s], here, [stop_s]])
        return len(here) > 0 and bool((np.diff(edges) <= max_gap_s).all())

    def columns(self, first: int, stop: int) -> Series:
        """The columns from `first` to before `stop`."""
        return Series(self.times_s, self.values[:, first:stop])

    def scaled(self, factor: np.ndarray) -> Series:
        """The values times `factor` [D]."""
        return Series(self.times_s, self.values * factor)


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording:
    """What a stretch of a log without a break in its clock says; None where nothing."""

    joint_pos: Series
    """[S, 12] rad, in our order and signs."""
    joint_vel: Series | None = None
    """[S, 12] rad/s"""
    joint_torque: Series | None = None
    """[S, 12] N m"""
    base_pos_w: Series | None = None
    """[S, 3] m"""
    base_wxyz: Series | None = None
    """[S, 4] of length 1"""
    base_lin_vel_b: Series | None = None
    """[S, 3] m/s"""
    base_ang_vel_b: Series | None = None
    """[S, 3] rad/s"""
    contact: Series | None = None
    """[S, 4] 0 or 1, in the order of `LEGS`."""
    command: Series | None = None
    """[S, 3] forward m/s, left m/s, yaw rad/s"""
    estimated: tuple[str, ...] = ()
    """What of it was estimated from the rest."""


def possible(values: np.ndarray) -> np.ndarray:
    """[S] bool: the row of `values` [S, D] is finite and not absurdly large."""
    return np.all(np.abs(values) < LARGEST, axis=1)  # NaN is not less.


def unit_attitudes(what: str, found: Series, findings: Findings) -> Series | None:
    """The attitudes [S, 4] that are about of length 1, made 1; None without any.

    Args:
        what: Names them where some are left out.
        found: Quaternions as they were told.
        findings: Told of those left out.
    """
    length = np.linalg.norm(found.values, axis=1)
    zero = length == 0
    good = np.abs(length - 1) <= UNIT_TOLERANCE
    findings.leave_out(f"{what} quaternion all zero", int(zero.sum()))
    wrong = length[~good & ~zero]
    if len(wrong):
        spread = f"{wrong.min():.3g} to {wrong.max():.3g} in place of 1"
        findings.leave_out(f"{what} quaternion of length {spread}", len(wrong))
    if not good.any():
        return None
    return Series(found.times_s[good], found.values[good] / length[good, None])
