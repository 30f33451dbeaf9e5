"""What a run of a bag says of a robot, with what cannot be true left out.

Shapes: S samples of a quantity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .bag_doubts import refuse_two_publishers
from .bag_findings import Findings
from .bag_map import BagError, BagMap
from .clock import Run, Timed

MIN_SAMPLES = 6
"""Samples of joints and base, for a cubic through them."""
UNIT_TOLERANCE = 0.01
"""By how much the length of a quaternion may differ from 1: it is made 1."""

_LARGEST = 1e9
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


@dataclass(frozen=True, eq=False)
class Bag:
    """What a run of a bag says of a robot; None where it says nothing."""

    joint_pos: Series
    """[S, 12] rad, in our order and signs."""
    joint_vel: Series | None
    """[S, 12] rad/s"""
    joint_torque: Series | None
    """[S, 12] N m"""
    base_pos_w: Series
    """[S, 3] m"""
    base_wxyz: Series
    """[S, 4] of length 1"""
    base_lin_vel_b: Series | None
    """[S, 3] m/s"""
    base_ang_vel_b: Series | None
    """[S, 3] rad/s"""
    contact: Series | None
    """[S, 4] 0 or 1, in the order of `LEGS`."""
    command: Series | None
    """[S, 3] forward m/s, left m/s, yaw rad/s"""


def bags_of(runs: list[Run], bag_map: BagMap, findings: Findings) -> list[Bag]:
    """Each run that tells enough of joints and base.

    Raises:
        BagError: none does, or a topic goes to and fro between two publishers.
    """
    found = [_bag(run, bag_map, findings) for run in runs]
    bags = [bag for bag in found if isinstance(bag, Bag)]
    for run, bag in zip(runs, found, strict=True):
        if isinstance(bag, Bag):
            continue
        topic, quantity = bag
        if not bags:
            raise BagError(
                f"{topic} tells no {quantity} that can be used: it needs {MIN_SAMPLES} "
                f"messages or more at different times{findings.reasons(topic)}"
            )
        for name, samples in run.items():
            findings.leave_out(f"{name} in a run that is too short", len(samples))
    return bags


def _bag(run: Run, bag_map: BagMap, findings: Findings) -> Bag | tuple[str, str]:
    """What a run says, or the topic and quantity that it says too little of."""
    at, to = bag_map.joints.topic, bag_map.base.topic
    joints, base = (_once(topic, run[topic], findings) for topic in (at, to))
    position = _series(at, joints, "position", findings)
    pose = _pose(to, base, findings)
    for topic, quantity, series in ((at, "position", position), (to, "pose", pose)):
        if series is None or len(series.times_s) < MIN_SAMPLES:
            return topic, quantity
    assert position is not None
    assert pose is not None
    refuse_two_publishers(at, *_all(run[at], "position"), "rad")
    times_s, poses = _all(run[to], "pose")
    refuse_two_publishers(to, times_s, poses[:, :3], "m")
    signs = np.array(bag_map.joints.signs)
    angles = position.values * signs + np.array(bag_map.joints.offsets_rad)
    imu = _of(run, bag_map.imu and bag_map.imu.topic, "ang_vel", findings)
    own_turn = _unless_zero(_series(to, base, "ang_vel", findings))
    feet = bag_map.contacts
    contact = _of(run, feet and feet.topic, "contact", findings)
    if contact is not None and feet is not None:
        touches = (contact.values > feet.above).astype(float)
        contact = Series(contact.times_s, touches)
    return Bag(
        joint_pos=Series(position.times_s, angles),
        joint_vel=_scaled(_series(at, joints, "velocity", findings), signs),
        joint_torque=_scaled(_series(at, joints, "effort", findings), signs),
        base_pos_w=Series(pose.times_s, pose.values[:, :3]),
        base_wxyz=Series(pose.times_s, pose.values[:, 3:]),
        # Many an odometry leaves its velocity at zero.
        base_lin_vel_b=_unless_zero(_series(to, base, "lin_vel", findings)),
        base_ang_vel_b=imu or own_turn,
        contact=contact,
        command=_of(run, bag_map.twist and bag_map.twist.topic, "command", findings),
    )


def _once(topic: str, samples: list[Timed], findings: Findings) -> list[Timed]:
    """The first of the samples that are of one time."""
    kept = [
        sample
        for index, sample in enumerate(samples)
        if index == 0 or sample[0] > samples[index - 1][0]
    ]
    findings.leave_out(f"{topic} at the time of another", len(samples) - len(kept))
    return kept


def _all(samples: list[Timed], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Times and values that can be, those of one time included."""
    told = [(time_s, numbers[name]) for time_s, numbers in samples if name in numbers]
    times_s = np.array([time_s for time_s, _ in told])
    values = np.array([value for _, value in told], dtype=float)
    possible = (np.abs(values) < _LARGEST).all(axis=1)  # NaN is not less.
    return times_s[possible], values[possible]


def _series(
    topic: str, samples: list[Timed], name: str, findings: Findings
) -> Series | None:
    """One quantity of a topic, where it is told and finite; None if it never is."""
    told = sum(name in numbers for _, numbers in samples)
    if not told:
        return None
    times_s, values = _all(samples, name)
    findings.leave_out(f"{topic} without a {name}", len(samples) - told)
    findings.leave_out(
        f"{topic} {name} not finite or above {_LARGEST:.0e}", told - len(times_s)
    )
    return Series(times_s, values) if len(times_s) else None


def _pose(topic: str, samples: list[Timed], findings: Findings) -> Series | None:
    """Poses whose quaternion is one, made to be of length 1."""
    found = _series(topic, samples, "pose", findings)
    if found is None:
        return None
    length = np.linalg.norm(found.values[:, 3:], axis=1)
    zero = length == 0
    good = np.abs(length - 1) <= UNIT_TOLERANCE
    findings.leave_out(f"{topic} quaternion all zero", int(zero.sum()))
    wrong = length[~good & ~zero]
    if len(wrong):
        spread = f"{wrong.min():.3g} to {wrong.max():.3g} in place of 1"
        findings.leave_out(f"{topic} quaternion of length {spread}", len(wrong))
    values = found.values[good]
    values[:, 3:] /= length[good, None]
    return Series(found.times_s[good], values) if good.any() else None


def _of(run: Run, topic: str | None, name: str, findings: Findings) -> Series | None:
    """One quantity of a topic that the map need not name."""
    if topic is None:
        return None
    return _series(topic, _once(topic, run[topic], findings), name, findings)


def _scaled(series: Series | None, factor: np.ndarray) -> Series | None:
    return None if series is None else Series(series.times_s, series.values * factor)


def _unless_zero(series: Series | None) -> Series | None:
    return series if series is not None and np.any(series.values) else None
