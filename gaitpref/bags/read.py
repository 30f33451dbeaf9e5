"""Messages of a ROS 2 bag as arrays over time.

Shapes: S samples of a topic.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from data.errors import FileError
from data.files import BoundedFile, open_regular
from data.limits import BAG_CHUNK_BYTES
from gaitpref.extras import require

from .bag_map import BagError, BagMap

_BASE_TYPES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "tf2_msgs/msg/TFMessage",
)


_MIN_SAMPLES = 6


@dataclass(frozen=True, eq=False)
class Series:
    """Samples of one quantity, in the order of time, no two at once."""

    times_s: np.ndarray
    """[S]"""
    values: np.ndarray
    """[S, ...]"""


@dataclass(frozen=True, eq=False)
class Bag:
    """What a bag says of a robot; None where it says nothing."""

    joint_pos: Series
    """[S, 12] rad, in our order and signs."""
    joint_vel: Series | None
    """[S, 12] rad/s"""
    joint_torque: Series | None
    """[S, 12] N m"""
    base_pos_w: Series
    """[S, 3] m"""
    base_wxyz: Series
    """[S, 4]"""
    base_lin_vel_b: Series | None
    """[S, 3] m/s"""
    base_ang_vel_b: Series | None
    """[S, 3] rad/s"""
    contact: Series | None
    """[S, 4] 0 or 1, in the order of `LEGS`."""
    command: Series | None
    """[S, 3] forward m/s, left m/s, yaw rad/s"""


def read_bag(path: Path, bag_map: BagMap) -> Bag:
    """Read the topics of a bag that its map names.

    Raises:
        BagError: it is no bag, or a topic or joint that is needed is not in it.
    """
    samples = _samples(path, bag_map)
    for topic in (bag_map.joints.topic, bag_map.base.topic):
        if not samples[topic]:
            raise BagError(
                f"{path} holds no message on {topic} that could be used; there are "
                f"{', '.join(sorted(_topics(path))) or 'none'}"
            )
    joints = samples[bag_map.joints.topic]
    signs = np.array(bag_map.joints.signs)
    position = _needed(joints, "position", bag_map.joints.topic)
    angles = position.values * signs + np.array(bag_map.joints.offsets_rad)
    base = samples[bag_map.base.topic]
    base_pos, base_wxyz = (
        _needed(base, name, bag_map.base.topic) for name in ("position", "wxyz")
    )
    imu = samples[bag_map.imu.topic] if bag_map.imu else []
    return Bag(
        joint_pos=Series(position.times_s, angles),
        joint_vel=_scaled(_series(joints, "velocity"), signs),
        joint_torque=_scaled(_series(joints, "effort"), signs),
        base_pos_w=base_pos,
        base_wxyz=base_wxyz,
        # Many an odometry leaves its velocity at zero.
        base_lin_vel_b=_unless_zero(_series(base, "lin_vel")),
        base_ang_vel_b=_series(imu, "ang_vel")
        or _unless_zero(_series(base, "ang_vel")),
        contact=_series(samples[bag_map.contacts.topic], "contact")
        if bag_map.contacts
        else None,
        command=_series(samples[bag_map.twist.topic], "command")
        if bag_map.twist
        else None,
    )


Sample = tuple[float, dict[str, list[float]]]


def _samples(path: Path, bag_map: BagMap) -> dict[str, list[Sample]]:
    """Time and numbers of every message of the mapped topics."""
    decoder = require("mcap_ros2.decoder", "view").DecoderFactory()
    parts = (bag_map.joints, bag_map.base, bag_map.imu, bag_map.contacts, bag_map.twist)
    topics = [part.topic for part in parts if part is not None]
    found: dict[str, list[Sample]] = defaultdict(list)
    try:
        with open_regular(path) as file:
            reader = require("mcap.reader", "view").make_reader(
                BoundedFile(file, BAG_CHUNK_BYTES), decoder_factories=[decoder]
            )
            for schema, channel, message, decoded in reader.iter_decoded_messages(
                topics, log_time_order=False
            ):
                for stamp, numbers in _numbers(
                    schema.name, channel.topic, decoded, bag_map
                ):
                    time_s = message.log_time / 1e9
                    if bag_map.time == "header" and stamp is not None:
                        time_s = stamp
                    found[channel.topic].append((time_s, numbers))
    except FileNotFoundError:
        raise BagError(f"{path} is missing; give a bag in MCAP") from None
    except (BagError, FileError):
        raise
    except Exception as error:
        told = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise BagError(
            f"{path} cannot be read as a ROS 2 bag in MCAP ({told}); "
            "`ros2 bag convert` turns other bags into MCAP"
        ) from error
    return found


def _topics(path: Path) -> list[str]:
    with open_regular(path) as file:
        summary = require("mcap.reader", "view").make_reader(file).get_summary()
    return [c.topic for c in summary.channels.values()] if summary else []


def _numbers(
    kind: str, topic: str, message: Any, bag_map: BagMap
) -> list[tuple[float | None, dict[str, list[float]]]]:
    """Stamp in s and numbers of a message, of each transform that is looked for."""
    if topic == bag_map.joints.topic:
        numbers = _joints(message, bag_map)
        return [(_stamp(message), numbers)] if numbers else []
    if topic == bag_map.base.topic:
        return _base(kind, message, bag_map)
    if bag_map.imu and topic == bag_map.imu.topic:
        return [(_stamp(message), {"ang_vel": _xyz(message.angular_velocity)})]
    if bag_map.contacts and topic == bag_map.contacts.topic:
        values = [float(v) for v in getattr(message, bag_map.contacts.field)]
        by_leg = dict(zip(bag_map.contacts.order, values, strict=True))
        legs = [float(by_leg[leg] > bag_map.contacts.above) for leg in _LEGS]
        return [(_stamp(message), {"contact": legs})]
    twist = message.twist if hasattr(message, "twist") else message
    asked = [twist.linear.x, twist.linear.y, twist.angular.z]
    return [(_stamp(message), {"command": asked})]


_LEGS = ("FR", "FL", "RR", "RL")


def _joints(message: Any, bag_map: BagMap) -> dict[str, list[float]] | None:
    """The twelve joints in our order; None for a message without all of them."""
    place = {name: index for index, name in enumerate(message.name)}
    if not all(name in place for name in bag_map.joints.names):
        return None
    order = [place[name] for name in bag_map.joints.names]
    return {
        member: [float(values[index]) for index in order]
        for member in ("position", "velocity", "effort")
        if len(values := getattr(message, member)) == len(message.name)
    }


def _base(
    kind: str, message: Any, bag_map: BagMap
) -> list[tuple[float | None, dict[str, list[float]]]]:
    if kind not in _BASE_TYPES:
        raise BagError(
            f"{bag_map.base.topic} is {kind}; the base is read from "
            f"{', '.join(_BASE_TYPES)}"
        )
    if kind == _BASE_TYPES[2]:
        wanted = (bag_map.base.frame, bag_map.base.child)
        return [
            (_stamp(t), _pose(t.transform.translation, t.transform.rotation))
            for t in message.transforms
            if (t.header.frame_id.lstrip("/"), t.child_frame_id.lstrip("/")) == wanted
        ]
    if kind == _BASE_TYPES[1]:
        pose = message.pose
        return [(_stamp(message), _pose(pose.position, pose.orientation))]
    pose, twist = message.pose.pose, message.twist.twist
    velocity = {"lin_vel": _xyz(twist.linear), "ang_vel": _xyz(twist.angular)}
    return [(_stamp(message), _pose(pose.position, pose.orientation) | velocity)]


def _pose(position: Any, turn: Any) -> dict[str, list[float]]:
    return {"position": _xyz(position), "wxyz": [turn.w, turn.x, turn.y, turn.z]}


def _xyz(vector: Any) -> list[float]:
    return [vector.x, vector.y, vector.z]


def _stamp(message: Any) -> float | None:
    """The message's own time; None where it has none or nobody filled it in."""
    header = getattr(message, "header", None)
    if header is None:
        return None
    time_s = header.stamp.sec + header.stamp.nanosec / 1e9
    return time_s or None


def _series(samples: list[Sample], name: str) -> Series | None:
    """One quantity of a topic; None if any message lacks it."""
    if not samples or not all(name in numbers for _, numbers in samples):
        return None
    times_s = np.array([time_s for time_s, _ in samples])
    values = np.array([numbers[name] for _, numbers in samples], dtype=float)
    times_s, order = np.unique(times_s, return_index=True)
    return Series(times_s, values[order]) if np.isfinite(values).all() else None


def _needed(samples: list[Sample], name: str, topic: str) -> Series:
    found = _series(samples, name)
    if found is None or len(found.times_s) < _MIN_SAMPLES:
        raise BagError(
            f"{topic} tells no {name} that can be used: it needs {_MIN_SAMPLES} "
            "messages or more, with finite numbers in all of them"
        )
    return found


def _scaled(series: Series | None, factor: np.ndarray) -> Series | None:
    return None if series is None else Series(series.times_s, series.values * factor)


def _unless_zero(series: Series | None) -> Series | None:
    return series if series is not None and np.any(series.values) else None
