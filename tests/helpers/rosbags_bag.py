"""An episode as a ROS 2 bag, written by rosbags in each of its forms."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import Writer, enums
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from data.episodes.episode import Episode
from data.features import JOINTS
from gaitpref.formats.ros2.definitions import LOW_STATE, SPORT_STATE, definition_of
from policy.robots.robot import Robot

NAMES = [f"{joint}_joint" for joint in JOINTS]
START_S = 1_700_000_000
ALL = ("/joint_states", "/odom", "/imu/data", "/lowstate", "/sportmodestate")


def typestore() -> Any:
    """Types of ROS and of Unitree, as a robot's computer knows them."""
    store = get_typestore(Stores.LATEST)
    for kind in (LOW_STATE, SPORT_STATE):
        store.register(get_types_from_msg(definition_of(kind) or "", kind))
    return store


class Sender:
    """Makes the messages of an episode."""

    def __init__(self, robot: Robot, names: Sequence[str] = NAMES) -> None:
        self.store = typestore()
        self.types = self.store.types
        self._robot, self._names = robot, list(names)

    def _v3(self, values: np.ndarray) -> Any:
        return self.types["geometry_msgs/msg/Vector3"](*map(float, values))

    def _header(self, t: float) -> Any:
        ns = round(t * 1e9)
        time = self.types["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9)
        return self.types["std_msgs/msg/Header"](time, "odom")

    def _imu_state(self, qpos: np.ndarray, qvel: np.ndarray) -> Any:
        single = np.float32
        return self.types["unitree_go/msg/IMUState"](
            quaternion=qpos[3:7].astype(single),
            gyroscope=qvel[3:6].astype(single),
            accelerometer=np.array([0, 0, 9.81], single),
            rpy=np.zeros(3, single),
            temperature=40,
        )

    def message(self, topic: str, t: float, qpos: np.ndarray, qvel: np.ndarray) -> Any:
        """What is sent on `topic` at `t` in the state `qpos` [19], `qvel` [18]."""
        angles, rates = qpos[self._robot.qpos_adr], qvel[self._robot.qvel_adr]
        w, x, y, z = map(float, qpos[3:7])
        turn = self.types["geometry_msgs/msg/Quaternion"](x, y, z, w)
        if topic == "/joint_states":
            kind = self.types["sensor_msgs/msg/JointState"]
            return kind(self._header(t), self._names, angles, rates, np.zeros(0))
        if topic == "/odom":
            place = self.types["geometry_msgs/msg/Point"](*map(float, qpos[:3]))
            pose = self.types["geometry_msgs/msg/Pose"](place, turn)
            still = self._v3(np.zeros(3))
            twist = self.types["geometry_msgs/msg/Twist"](still, still)
            nothing = np.zeros(36)
            return self.types["nav_msgs/msg/Odometry"](
                self._header(t),
                "base_link",
                self.types["geometry_msgs/msg/PoseWithCovariance"](pose, nothing),
                self.types["geometry_msgs/msg/TwistWithCovariance"](twist, nothing),
            )
        if topic == "/imu/data":
            nothing = np.zeros(9)
            turning, pull = self._v3(qvel[3:6]), self._v3(np.array([0, 0, 9.81]))
            return self.types["sensor_msgs/msg/Imu"](
                self._header(t), turn, nothing, turning, nothing, pull, nothing
            )
        if topic == "/lowstate":
            return self._low_state(angles, rates, self._imu_state(qpos, qvel))
        ns = round(t * 1e9)
        return self.types[SPORT_STATE](
            stamp=self.types["unitree_go/msg/TimeSpec"](ns // 10**9, ns % 10**9),
            error_code=0,
            imu_state=self._imu_state(qpos, qvel),
            mode=3,
            progress=0.0,
            gait_type=1,
            foot_raise_height=0.0,
            position=qpos[:3].astype(np.float32),
            body_height=0.3,
            velocity=np.full(3, 9.0, np.float32),
            yaw_speed=0.0,
            range_obstacle=np.zeros(4, np.float32),
            foot_force=np.zeros(4, np.int16),
            foot_position_body=np.zeros(12, np.float32),
            foot_speed_body=np.zeros(12, np.float32),
        )

    def _low_state(self, angles: np.ndarray, rates: np.ndarray, imu: Any) -> Any:
        def motor(q: float, dq: float) -> Any:
            return self.types["unitree_go/msg/MotorState"](
                1, q, dq, 0.0, 2.5, 0.0, 0.0, 0.0, 30, 0, np.zeros(2, np.uint32)
            )

        moving = [motor(*map(float, both)) for both in zip(angles, rates, strict=True)]
        battery = self.types["unitree_go/msg/BmsState"](
            *(0,) * 6,
            np.zeros(2, np.int8),
            np.zeros(2, np.int8),
            np.zeros(15, np.uint16),
        )
        return self.types[LOW_STATE](
            head=np.zeros(2, np.uint8),
            level_flag=0,
            frame_reserve=0,
            sn=np.zeros(2, np.uint32),
            version=np.zeros(2, np.uint32),
            bandwidth=0,
            imu_state=imu,
            motor_state=moving + [motor(0.0, 0.0)] * 8,
            bms_state=battery,
            foot_force=np.array([30, 5, 30, 5], np.int16),
            foot_force_est=np.zeros(4, np.int16),
            tick=0,
            wireless_remote=np.zeros(40, np.uint8),
            bit_flag=0,
            adc_reel=0.0,
            temperature_ntc1=0,
            temperature_ntc2=0,
            power_v=0.0,
            power_a=0.0,
            fan_frequency=np.zeros(4, np.uint16),
            reserve=0,
            crc=0,
        )


def write_rosbag(
    folder: Path,
    episode: Episode,
    robot: Robot,
    topics: Sequence[str],
    *,
    storage: str = "MCAP",
    packed: str = "NONE",
    names: Sequence[str] = NAMES,
) -> Path:
    """Write every state of `episode` on `topics` into a new bag."""
    sender = Sender(robot, names)
    writer = Writer(folder, version=9, storage_plugin=enums.StoragePlugin[storage])
    if packed != "NONE":
        zstd = enums.CompressionFormat.ZSTD
        writer.set_compression(enums.CompressionMode[packed], zstd)
    with writer:
        connections = {}
        for index in range(episode.num_steps + 1):
            t = START_S + index * episode.meta.control_dt_s
            for topic in topics:
                sent = sender.message(
                    topic, t, episode.qpos[index], episode.qvel[index]
                )
                kind = sent.__msgtype__
                if topic not in connections:
                    connections[topic] = writer.add_connection(
                        topic, kind, typestore=sender.store
                    )
                raw = sender.store.serialize_cdr(sent, kind)
                writer.write(connections[topic], round(t * 1e9), raw)
    return folder
