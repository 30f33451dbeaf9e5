"""Messages of a ROS 2 bag as arrays over time.

Shapes: S samples of a topic.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from data.features import LEGS

from .bag_findings import Findings
from .bag_map import BagError, BagMap
from .clock import Sample
from .mcap_file import Message, messages, topics_in

_BASE_TYPES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "tf2_msgs/msg/TFMessage",
)
_TWIST_TYPES = ("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped")

Numbers = dict[str, list[float]]
"""What a message says, by quantity."""


@dataclass(frozen=True, eq=False)
class _Joints:
    """Joint messages; remembers the names of those that lack one of the twelve."""

    names: tuple[str, ...]
    others: set[str]

    def numbers(self, message: Any) -> Numbers | None:
        """The twelve joints in our order; None for a message without all of them."""
        place = {name: index for index, name in enumerate(message.name)}
        if not all(name in place for name in self.names):
            self.others.update(message.name)
            return None
        order = [place[name] for name in self.names]
        return {
            member: [float(values[index]) for index in order]
            for member in ("position", "velocity", "effort")
            if len(values := getattr(message, member)) == len(message.name)
        }


def read_samples(
    files: list[Path], bag_map: BagMap, findings: Findings
) -> list[Sample]:
    """The numbers in all messages of the topics that the map names, as written.

    Raises:
        BagError: it is no bag, or a topic or joint that is needed is not in it.
    """
    joints = _Joints(bag_map.joints.names, set())
    parts = (bag_map.joints, bag_map.base, bag_map.imu, bag_map.contacts, bag_map.twist)
    topics = [part.topic for part in parts if part is not None]
    samples: list[Sample] = []
    for message in messages(files, topics, findings):
        for stamp_s, numbers in _numbers(message, bag_map, joints):
            if numbers is None:
                findings.leave_out(f"{message.topic} without all twelve joints", 1)
            else:
                found = Sample(message.topic, message.log_s, stamp_s, numbers)
                samples.append(found)
    present = {sample.topic for sample in samples}
    for topic in (bag_map.joints.topic, bag_map.base.topic):
        if topic not in present:
            raise _nothing_on(topic, files, bag_map, joints, findings)
    return samples


def _nothing_on(
    topic: str,
    files: list[Path],
    bag_map: BagMap,
    joints: _Joints,
    findings: Findings,
) -> BagError:
    source = files[0] if len(files) == 1 else files[0].parent
    problem = f"{source} holds no message on {topic} that could be used"
    broken = "".join(f"; {line}" for line in findings.told)
    if topic == bag_map.joints.topic and joints.others:
        wanted = [name for name in joints.names if name not in joints.others]
        return BagError(
            f"{problem}: its joints are {', '.join(sorted(joints.others))}; names in "
            "[joints] of the map wants "
            f"{', '.join(wanted) or 'all twelve in one message'}{broken}"
        )
    there = topics_in(files)
    if topic in there and topic == bag_map.base.topic:
        frames = f"{bag_map.base.frame} to {bag_map.base.child}"
        return BagError(f"{problem}: no transform from {frames}{broken}")
    return BagError(f"{problem}; there are {', '.join(there) or 'none'}{broken}")


def _numbers(
    message: Message, bag_map: BagMap, joints: _Joints
) -> Iterator[tuple[float | None, Numbers | None]]:
    """Stamp in s and numbers of a message, of each transform that is looked for."""
    topic, content = message.topic, message.content
    if topic == bag_map.joints.topic:
        _require_kind(message, "the joints are", "sensor_msgs/msg/JointState")
        yield _stamp(content), joints.numbers(content)
    elif topic == bag_map.base.topic:
        _require_kind(message, "the base is", *_BASE_TYPES)
        yield from _base(message.kind, content, bag_map)
    elif bag_map.imu and topic == bag_map.imu.topic:
        _require_kind(message, "turning rates are", "sensor_msgs/msg/Imu")
        yield _stamp(content), {"ang_vel": _xyz(content.angular_velocity)}
    elif bag_map.contacts and topic == bag_map.contacts.topic:
        yield _stamp(content), _contact(message, bag_map)
    else:
        _require_kind(message, "the command is", *_TWIST_TYPES)
        twist = content.twist if hasattr(content, "twist") else content
        asked = [twist.linear.x, twist.linear.y, twist.angular.z]
        yield _stamp(content), {"command": asked}


def _require_kind(message: Message, what: str, *kinds: str) -> None:
    if message.kind not in kinds:
        raise BagError(
            f"{message.topic} is {message.kind}; {what} read from {', '.join(kinds)}"
        )


def _contact(message: Message, bag_map: BagMap) -> Numbers:
    """What the feet tell, in our order; compared with the threshold later."""
    assert bag_map.contacts is not None
    told: Any = getattr(message.content, bag_map.contacts.field, None)
    values = list(told) if hasattr(told, "__len__") else []
    if len(values) != len(LEGS):
        raise BagError(
            f"{message.topic} has no four values in {bag_map.contacts.field!r}; "
            "[contacts] of the map names the member that holds one for each foot, "
            f"{message.kind} has {', '.join(sorted(vars(message.content)))}"
        )
    by_leg = dict(zip(bag_map.contacts.order, map(float, values), strict=True))
    return {"contact": [by_leg[leg] for leg in LEGS]}


def _base(
    kind: str, message: Any, bag_map: BagMap
) -> Iterator[tuple[float | None, Numbers]]:
    if kind == _BASE_TYPES[2]:
        wanted = (bag_map.base.frame, bag_map.base.child)
        for each in message.transforms:
            frames = each.header.frame_id.lstrip("/"), each.child_frame_id.lstrip("/")
            if frames == wanted:
                place = each.transform
                yield _stamp(each), _pose(place.translation, place.rotation)
    elif kind == _BASE_TYPES[1]:
        pose = message.pose
        yield _stamp(message), _pose(pose.position, pose.orientation)
    else:
        pose, twist = message.pose.pose, message.twist.twist
        velocity = {"lin_vel": _xyz(twist.linear), "ang_vel": _xyz(twist.angular)}
        yield _stamp(message), _pose(pose.position, pose.orientation) | velocity


def _pose(position: Any, turn: Any) -> Numbers:
    return {"pose": [*_xyz(position), turn.w, turn.x, turn.y, turn.z]}


def _xyz(vector: Any) -> list[float]:
    return [vector.x, vector.y, vector.z]


def _stamp(message: Any) -> float | None:
    """The message's own time; None where it has none or nobody filled it in."""
    header = getattr(message, "header", None)
    if header is None:
        return None
    time_s = header.stamp.sec + header.stamp.nanosec / 1e9
    return time_s or None
