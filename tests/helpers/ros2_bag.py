"""A bag as a quadruped's computer writes it, with a motion known in closed form."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from mcap_ros2.writer import Writer

from gaitpref.formats.viewers.messages import definitions, header, quaternion, vector
from policy.robots.robot import Robot

_LINE = "=" * 80
_PARTS = {
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    "geometry_msgs/Pose": "geometry_msgs/Point position\n"
    "geometry_msgs/Quaternion orientation\n",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\n"
    "geometry_msgs/Vector3 angular\n",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\n"
    "float64[36] covariance\n",
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist\n"
    "float64[36] covariance\n",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n",
}
_MAIN = {
    "sensor_msgs/msg/JointState": "std_msgs/Header header\nstring[] name\n"
    "float64[] position\nfloat64[] velocity\nfloat64[] effort\n",
    "nav_msgs/msg/Odometry": "std_msgs/Header header\nstring child_frame_id\n"
    "geometry_msgs/PoseWithCovariance pose\n"
    "geometry_msgs/TwistWithCovariance twist\n",
    "geometry_msgs/msg/PoseStamped": "std_msgs/Header header\n"
    "geometry_msgs/Pose pose\n",
    "sensor_msgs/msg/Imu": "std_msgs/Header header\n"
    "geometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
    "geometry_msgs/Vector3 angular_velocity\n"
    "float64[9] angular_velocity_covariance\n"
    "geometry_msgs/Vector3 linear_acceleration\n"
    "float64[9] linear_acceleration_covariance\n",
    "geometry_msgs/msg/Twist": "geometry_msgs/Vector3 linear\n"
    "geometry_msgs/Vector3 angular\n",
    "std_msgs/msg/Float32MultiArray": "float32[] data\n",
}
PARTS_TEXT = "".join(f"{_LINE}\nMSG: {n}\n{t}" for n, t in _PARTS.items())
START_S = 1_700_000_000

Alter = Callable[[float, str, dict[str, Any]], Iterable[dict[str, Any]]]
"""Time in s, topic and message to what is sent in its place."""


class Motion:
    """A robot that walks ahead, sways, turns and swings its legs at 2 Hz."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._phase = np.arange(12) / 2

    def joint_pos(self, t: float) -> np.ndarray:
        return self._robot.home_joint_pos + 0.3 * np.sin(4 * np.pi * t + self._phase)

    def joint_vel(self, t: np.ndarray) -> np.ndarray:
        return 1.2 * np.pi * np.cos(4 * np.pi * t[:, None] + self._phase)

    def yaw(self, t: float) -> float:
        return 0.4 * t + 0.1 * np.sin(2 * np.pi * t)

    def base_pos(self, t: float) -> np.ndarray:
        # Sideways and up and down at the rhythm of the legs.
        return np.array(
            [0.6 * t, 0.05 * np.sin(2 * np.pi * t), 5 + 0.02 * np.sin(4 * np.pi * t)]
        )

    def wxyz(self, t: float) -> np.ndarray:
        half = self.yaw(t) / 2
        return np.array([np.cos(half), 0, 0, np.sin(half)])

    def lin_vel_b(self, t: np.ndarray) -> np.ndarray:
        x = np.full_like(t, 0.6)
        y = 0.1 * np.pi * np.cos(2 * np.pi * t)
        z = 0.08 * np.pi * np.cos(4 * np.pi * t)
        yaw = 0.4 * t + 0.1 * np.sin(2 * np.pi * t)
        c, s = np.cos(yaw), np.sin(yaw)
        return np.stack([c * x + s * y, c * y - s * x, z], axis=-1)

    def ang_vel_b(self, t: np.ndarray) -> np.ndarray:
        yaw_rate = 0.4 + 0.2 * np.pi * np.cos(2 * np.pi * t)
        return np.stack([0 * t, 0 * t, yaw_rate], axis=-1)


def write_bag(
    path: Path,
    motion: Motion,
    names: list[str],
    *,
    base: str = "pose",
    duration_s: float = 8.0,
    full: bool = False,
    alter: Alter = lambda t, topic, message: [message],
    chunk_bytes: int | None = None,
) -> None:
    """Write joints at about 200 Hz and the base at about 100 Hz.

    Stamps jitter, messages are recorded late and out of order, a tenth is lost, and so
    is 0.1 s at 2 s and 0.8 s at 5 s. The names of the joints are in another order in
    every message. `full` adds what a good driver tells besides; `alter` gives what is
    sent in the place of a message. With `chunk_bytes` the file is in such chunks and
    in the order of recording, else topic after topic.
    """
    rng = np.random.default_rng(0)
    texts = {n: main + PARTS_TEXT for n, main in _MAIN.items()}
    rows: list[tuple[int, str, str, Any]] = []

    def send(t: float, topic: str, kind: str, message: Any) -> None:
        lost = 2.0 < t < 2.1 or 5.0 < t < 5.8
        if not lost and rng.random() > 0.1:
            late_s = rng.exponential(0.004)
            time_ns = round((START_S + t + late_s) * 1e9)
            rows.extend(
                (time_ns, topic, kind, sent) for sent in alter(t, topic, message)
            )

    def times(rate_hz: float) -> np.ndarray:
        even = np.arange(0, duration_s, 1 / rate_hz)
        return np.sort(even + rng.uniform(-0.3, 0.3, len(even)) / rate_hz)

    for t in times(200):
        order = rng.permutation(12)
        position, velocity = motion.joint_pos(t), motion.joint_vel(np.array([t]))[0]
        state = {
            "header": _stamp(t),
            "name": ["head", *(names[joint] for joint in order)],
            "position": [0.5, *position[order]],
            "velocity": [0.0, *velocity[order]] if full else [],
            "effort": [0.0, *(order + 1.0)] if full else [],
        }
        send(t, "/joint_states", "sensor_msgs/msg/JointState", state)
    for t in times(100):
        pose = {
            "position": vector(motion.base_pos(t)),
            "orientation": quaternion(motion.wxyz(t)),
        }
        send(t, "/base", *_base(base, t, pose, motion, full))
        if full:
            gyro = vector(motion.ang_vel_b(np.array([t]))[0])
            send(t, "/imu", "sensor_msgs/msg/Imu", _imu(t, gyro))
            asked = {
                "linear": vector(np.array([0.5, 0, 0])),
                "angular": vector(np.zeros(3)),
            }
            send(t, "/cmd_vel", "geometry_msgs/msg/Twist", asked)
            forces = {"data": [30.0, 0.0, 0.0, 40.0 if t < 4 else 0.0]}
            send(t, "/feet", "std_msgs/msg/Float32MultiArray", forces)
    if chunk_bytes is not None:
        rows.sort(key=lambda row: row[0])
    size = chunk_bytes or 2**20
    with path.open("wb") as file, Writer(file, chunk_size=size) as writer:
        texts |= definitions()
        schemas = {n: writer.register_msgdef(n, text) for n, text in texts.items()}
        for time_ns, topic, kind, message in rows:
            writer.write_message(topic, schemas[kind], message, time_ns, time_ns)


def _stamp(t: float) -> dict[str, Any]:
    return header(round((START_S + t) * 1e9), "odom")


def _base(
    base: str, t: float, pose: dict, motion: Motion, full: bool
) -> tuple[str, dict[str, Any]]:
    if base == "tf":
        other = {"translation": vector(np.ones(3)), "rotation": pose["orientation"]}
        own = {"translation": pose["position"], "rotation": pose["orientation"]}
        named = [("map", other), ("base_link", own)]
        return "tf2_msgs/msg/TFMessage", {
            "transforms": [
                {"header": _stamp(t), "child_frame_id": child, "transform": transform}
                for child, transform in named
            ]
        }
    if base == "odometry":
        speed = motion.lin_vel_b(np.array([t]))[0] if full else np.zeros(3)
        twist = {"linear": vector(speed), "angular": vector(np.zeros(3))}
        return "nav_msgs/msg/Odometry", {
            "header": _stamp(t),
            "child_frame_id": "base_link",
            "pose": {"pose": pose, "covariance": [0.0] * 36},
            "twist": {"twist": twist, "covariance": [0.0] * 36},
        }
    return "geometry_msgs/msg/PoseStamped", {"header": _stamp(t), "pose": pose}


def _imu(t: float, gyro: dict[str, float]) -> dict[str, Any]:
    nothing = [0.0] * 9
    return {
        "header": _stamp(t),
        "orientation": quaternion(np.array([1.0, 0, 0, 0])),
        "orientation_covariance": nothing,
        "angular_velocity": gyro,
        "angular_velocity_covariance": nothing,
        "linear_acceleration": vector(np.array([0, 0, 9.81])),
        "linear_acceleration_covariance": nothing,
    }
