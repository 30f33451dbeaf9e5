"""What each run of a bag says of a robot, with what cannot be true left out.

Shapes: S samples of a quantity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaitpref.formats.logs.doubts import refuse_two_publishers
from gaitpref.formats.logs.log_findings import Findings
from gaitpref.formats.logs.log_map import LogError, LogMap
from gaitpref.formats.logs.recording import (
    LARGEST,
    MIN_SAMPLES,
    Recording,
    Series,
    possible,
    unit_attitudes,
)

from .clock import Run, Timed


def recordings_of(
    runs: list[Run], log_map: LogMap, findings: Findings
) -> list[Recording]:
    """Each run that tells enough of joints and base.

    Raises:
        LogError: none does, or a topic goes to and fro between two publishers.
    """
    found = [_recording(run, log_map, findings) for run in runs]
    recordings = [each for each in found if isinstance(each, Recording)]
    for run, each in zip(runs, found, strict=True):
        if isinstance(each, Recording):
            continue
        topic, quantity = each
        if not recordings:
            raise LogError(
                f"{topic} tells no {quantity} that can be used: it needs {MIN_SAMPLES} "
                f"messages or more at different times{findings.reasons(topic)}"
            )
        for name, samples in run.items():
            findings.leave_out(f"{name} in a run that is too short", len(samples))
    return recordings


def _recording(
    run: Run, log_map: LogMap, findings: Findings
) -> Recording | tuple[str, str]:
    """What a run says, or the topic and quantity that it says too little of."""
    at = log_map.joints.topic
    joints = _once(at, run[at], findings)
    position = _series(at, joints, "position", findings)
    if position is None or len(position.times_s) < MIN_SAMPLES:
        return at, "position"
    refuse_two_publishers(at, *_all(run[at], "position"), "rad")
    signs = np.array(log_map.joints.signs)
    angles = position.values * signs + np.array(log_map.joints.offsets_rad)
    base = _base(run, log_map, findings)
    if base is None:
        return log_map.base_topic, "pose"
    feet = log_map.contacts
    contact = _of(run, feet and feet.topic, "contact", findings)
    if contact is not None and feet is not None:
        touches = (contact.values > feet.above).astype(float)
        contact = Series(contact.times_s, touches)
    velocity = _series(at, joints, "velocity", findings)
    torque = _series(at, joints, "effort", findings)
    return Recording(
        joint_pos=Series(position.times_s, angles),
        joint_vel=velocity and velocity.scaled(signs),
        joint_torque=torque and torque.scaled(signs),
        contact=contact,
        command=_of(run, log_map.twist and log_map.twist.topic, "command", findings),
        base_pos_w=base.pos_w,
        base_wxyz=base.wxyz,
        base_lin_vel_b=base.lin_vel_b,
        base_ang_vel_b=base.ang_vel_b,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Base:
    """What a run says of the base."""

    pos_w: Series | None = None
    wxyz: Series | None
    lin_vel_b: Series | None = None
    ang_vel_b: Series | None


def _base(run: Run, log_map: LogMap, findings: Findings) -> _Base | None:
    """What a run says of the base; None where it tells too few poses.

    A bag whose map names no base may lack it: the legs tell it then.
    """
    imu = log_map.imu.topic if log_map.imu else log_map.joints.topic
    turn = _of(run, imu, "ang_vel", findings)
    to = log_map.base_topic
    if not run[to] and log_map.may_lack_base:
        attitude = _of(run, imu, "attitude", findings)
        wxyz = attitude and unit_attitudes(imu, attitude, findings)
        return _Base(wxyz=wxyz, ang_vel_b=turn)
    base = _once(to, run[to], findings)
    pose = _series(to, base, "pose", findings)
    wxyz = pose and unit_attitudes(to, pose.columns(3, 7), findings)
    if pose is None or wxyz is None or len(wxyz.times_s) < MIN_SAMPLES:
        return None
    places = pose.columns(0, 3)
    times_s, poses = _all(run[to], "pose")
    refuse_two_publishers(to, times_s, poses[:, :3], "m")
    kept = np.isin(places.times_s, wxyz.times_s)
    return _Base(
        pos_w=Series(places.times_s[kept], places.values[kept]),
        wxyz=wxyz,
        # Many an odometry leaves its velocity at zero.
        lin_vel_b=_unless_zero(_series(to, base, "lin_vel", findings)),
        ang_vel_b=turn or _unless_zero(_series(to, base, "ang_vel", findings)),
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
    kept = possible(values)
    return times_s[kept], values[kept]


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
        f"{topic} {name} not finite or above {LARGEST:.0e}", told - len(times_s)
    )
    return Series(times_s, values) if len(times_s) else None


def _of(run: Run, topic: str | None, name: str, findings: Findings) -> Series | None:
    """One quantity of a topic that the map need not name."""
    if topic is None or not run[topic]:
        return None
    return _series(topic, _once(topic, run[topic], findings), name, findings)


def _unless_zero(series: Series | None) -> Series | None:
    return series if series is not None and np.any(series.values) else None
