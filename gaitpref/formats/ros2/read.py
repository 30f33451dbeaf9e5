"""Messages of a ROS 2 bag as samples of what they say of a robot."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from data.features import JOINTS, LEGS
from gaitpref.formats.logs.log_findings import Findings
from gaitpref.formats.logs.log_map import LogError, LogMap

from .bag_messages import Message, messages, topics_in
from .clock import Sample
from .definitions import LOW_STATE, SPORT_STATE
from .joint_guess import told_of_names

_JOINT_TYPES = ("sensor_msgs/msg/JointState", LOW_STATE)
_TF = "tf2_msgs/msg/TFMessage"
_POSE = "geometry_msgs/msg/PoseStamped"
_BASE_TYPES = ("nav_msgs/msg/Odometry", _POSE, _TF, SPORT_STATE)
_IMU_TYPES = ("sensor_msgs/msg/Imu", LOW_STATE, SPORT_STATE)
_TWIST_TYPES = ("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped")

_WIDTHS = {
    "position": 12,
    "velocity": 12,
    "effort": 12,
    "pose": 7,
    "attitude": 4,
    "lin_vel": 3,
    "ang_vel": 3,
    "contact": 4,
    "command": 3,
}
"""How many numbers each quantity has."""

Numbers = dict[str, list[float]]
"""What a message says, by quantity."""
_Told = Iterator[tuple[float | None, Numbers | None]]
"""Stamp in s and numbers of a message; None for one that lacks a joint."""
_Reader = Callable[[Message], _Told]


def read_samples(
    files: list[Path], log_map: LogMap, findings: Findings
) -> list[Sample]:
    """The numbers in all messages of the topics that the map names, as written.

    Raises:
        LogError: it is no bag, or a topic or joint that is needed is not in it.
    """
    reading = _Reading(log_map)
    samples: list[Sample] = []
    for message in messages(files, list(reading.of), findings):
        for stamp_s, numbers in _checked(message, reading):
            if numbers is None:
                findings.leave_out(f"{message.topic} without all twelve joints", 1)
            else:
                found = Sample(message.topic, message.log_s, stamp_s, numbers)
                samples.append(found)
    present = {sample.topic for sample in samples}
    needed = [log_map.joints.topic]
    if not log_map.may_lack_base:
        needed.append(log_map.base_topic)
    for topic in needed:
        if topic not in present:
            raise _nothing_on(topic, files, log_map, reading, findings)
    if log_map.base_topic not in present and not any(
        "attitude" in sample.numbers for sample in samples
    ):
        raise _nothing_on(log_map.base_topic, files, log_map, reading, findings)
    return samples


def _checked(
    message: Message, reading: _Reading
) -> list[tuple[float | None, Numbers | None]]:
    """What a message tells, as numbers, as many as there should be.

    Raises:
        LogError: the bag's own definition of its type makes it something else.
    """
    try:
        told = [
            (
                stamp_s,
                numbers and {n: list(map(float, v)) for n, v in numbers.items()},
            )
            for stamp_s, numbers in reading(message)
        ]
    except (AttributeError, TypeError, ValueError, IndexError) as error:
        found = " ".join(f"{type(error).__name__}: {error}".split())[:120]
        raise LogError(
            f"{message.topic} holds no {message.kind} as ROS has it ({found})"
        ) from error
    for _, numbers in told:
        for name, values in (numbers or {}).items():
            if len(values) != _WIDTHS[name]:
                raise LogError(
                    f"{message.topic} tells {len(values)} numbers of {name}, it has "
                    f"{_WIDTHS[name]}"
                )
    return told


class _Reading:
    """Reads messages by topic, one of which may tell of several things; remembers the
    names of joints in messages that lack one of the twelve."""

    def __init__(self, log_map: LogMap) -> None:
        self._map = log_map
        self.other_joints: set[str] = set()
        self.of: dict[str, list[_Reader]] = defaultdict(list)
        self.of[log_map.joints.topic].append(self._joints)
        if log_map.base_topic:
            self.of[log_map.base_topic].append(self._base)
        for part, read in (
            (log_map.imu, _imu),
            (log_map.contacts, self._contact),
            (log_map.twist, _twist),
        ):
            if part is not None:
                self.of[part.topic].append(read)

    def __call__(self, message: Message) -> _Told:
        """All that a message tells at once, of each transform that is looked for."""
        first, *others = self.of[message.topic]
        if not others:
            yield from first(message)
            return
        together: Numbers = {}
        stamp_s: float | None = None
        for read in (first, *others):
            for own_s, numbers in read(message):
                stamp_s = own_s
                together |= numbers or {}
        yield stamp_s, together or None

    def _joints(self, message: Message) -> _Told:
        _require_kind(message, "the joints are", *_JOINT_TYPES)
        content, names = message.content, self._map.joints.names
        if message.kind == LOW_STATE:
            motors = content.motor_state[: len(JOINTS)]
            numbers = {
                "position": [motor.q for motor in motors],
                "velocity": [motor.dq for motor in motors],
                "effort": [motor.tau_est for motor in motors],
            }
            yield None, numbers | _of_imu_state(content.imu_state)
            return
        place = {name: index for index, name in enumerate(content.name)}
        if not all(name in place for name in names):
            self.other_joints.update(content.name)
            yield _stamp(content), None
            return
        order = [place[name] for name in names]
        yield (
            _stamp(content),
            {
                member: [float(values[index]) for index in order]
                for member in ("position", "velocity", "effort")
                if len(values := getattr(content, member)) == len(content.name)
            },
        )

    def _base(self, message: Message) -> _Told:
        _require_kind(message, "the base is", *_BASE_TYPES)
        content, base = message.content, self._map.base
        if message.kind == _TF:
            wanted = ("odom", "base_link") if base is None else (base.frame, base.child)
            for each in content.transforms:
                frames = each.header.frame_id, each.child_frame_id
                if tuple(frame.lstrip("/") for frame in frames) == wanted:
                    place = each.transform
                    yield _stamp(each), _pose(place.translation, place.rotation)
        elif message.kind == _POSE:
            pose = content.pose
            yield _stamp(content), _pose(pose.position, pose.orientation)
        elif message.kind == SPORT_STATE:
            # Its velocity is left alone: firmware differs in the frame it is in.
            told = _of_imu_state(content.imu_state)
            pose = {"pose": [*map(float, content.position), *told["attitude"]]}
            yield _stamp(content), pose | {"ang_vel": told["ang_vel"]}
        else:
            pose, twist = content.pose.pose, content.twist.twist
            velocity = {"lin_vel": _xyz(twist.linear), "ang_vel": _xyz(twist.angular)}
            yield _stamp(content), _pose(pose.position, pose.orientation) | velocity

    def _contact(self, message: Message) -> _Told:
        """What the feet tell, in our order; compared with the threshold later."""
        feet = self._map.contacts
        assert feet is not None
        told: Any = getattr(message.content, feet.field, None)
        values = list(told) if hasattr(told, "__len__") else []
        if len(values) != len(LEGS):
            raise LogError(
                f"{message.topic} has no four values in {feet.field!r}; [contacts] of "
                "the map names the member that holds one for each foot, "
                f"{message.kind} has {', '.join(sorted(vars(message.content)))}"
            )
        by_leg = dict(zip(feet.order, map(float, values), strict=True))
        yield _stamp(message.content), {"contact": [by_leg[leg] for leg in LEGS]}


def _imu(message: Message) -> _Told:
    _require_kind(message, "turning rates are", *_IMU_TYPES)
    content = message.content
    if message.kind != _IMU_TYPES[0]:
        yield _stamp(content), _of_imu_state(content.imu_state)
        return
    numbers = {"ang_vel": _xyz(content.angular_velocity)}
    # As the message says: -1 stands for an IMU that gives no attitude.
    if content.orientation_covariance[0] != -1:
        turn = content.orientation
        numbers["attitude"] = [turn.w, turn.x, turn.y, turn.z]
    yield _stamp(content), numbers


def _of_imu_state(state: Any) -> Numbers:
    """Attitude wxyz and turning rates of `unitree_go/IMUState`."""
    return {
        "attitude": list(map(float, state.quaternion)),
        "ang_vel": list(map(float, state.gyroscope)),
    }


def _twist(message: Message) -> _Told:
    _require_kind(message, "the command is", *_TWIST_TYPES)
    content = message.content
    twist = content.twist if hasattr(content, "twist") else content
    asked = [twist.linear.x, twist.linear.y, twist.angular.z]
    yield _stamp(content), {"command": asked}


def _nothing_on(
    topic: str,
    files: list[Path],
    log_map: LogMap,
    reading: _Reading,
    findings: Findings,
) -> LogError:
    source = files[0] if len(files) == 1 else files[0].parent
    problem = f"{source} holds no message on {topic} that could be used"
    broken = "".join(f"; {line}" for line in findings.told)
    others = reading.other_joints
    if topic == log_map.joints.topic and others:
        names = told_of_names(others, log_map.joints.names)
        return LogError(f"{problem}: {names}{broken}")
    there = topics_in(files)
    if topic in there and topic == log_map.base_topic and log_map.base is not None:
        frames = f"{log_map.base.frame} to {log_map.base.child}"
        return LogError(f"{problem}: no transform from {frames}{broken}")
    told = f"{problem}; there are {', '.join(there) or 'none'}"
    if topic == log_map.base_topic:
        told = (
            f"{told}; without a base, an IMU with its attitude in [imu] of the map "
            "will do: height and velocity are estimated then"
        )
    return LogError(f"{told}{broken}")


def _require_kind(message: Message, what: str, *kinds: str) -> None:
    if message.kind not in kinds:
        raise LogError(
            f"{message.topic} is {message.kind}; {what} read from {', '.join(kinds)}"
        )


def _pose(position: Any, turn: Any) -> Numbers:
    return {"pose": [*_xyz(position), turn.w, turn.x, turn.y, turn.z]}


def _xyz(vector: Any) -> list[float]:
    return [vector.x, vector.y, vector.z]


def _stamp(message: Any) -> float | None:
    """The message's own time; None where it has none or nobody filled it in."""
    header = getattr(message, "header", message)
    stamp = getattr(header, "stamp", None)
    if stamp is None:
        return None
    time_s = stamp.sec + stamp.nanosec / 1e9
    return time_s or None
