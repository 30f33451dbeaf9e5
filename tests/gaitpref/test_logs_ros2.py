"""Bags as ROS 2 writes them, of a walk whose truth is known."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard

from data.datasets.dataset import Dataset
from data.episodes.episode import Episode
from data.features import column
from gaitpref.cli.main import main
from policy.robots.robot import Robot, load_robot
from tests.helpers.walked import walked

pytest.importorskip("rosbags.rosbag2", reason="needs the extra `logs`")
pytest.importorskip("mcap_ros2.writer", reason="needs the extra `logs`")

from mcap_ros2.writer import Writer

from tests.helpers.rosbags_bag import write_rosbag

MAP = 'robot = "go1"\ncommand = [0.5, 0.0, 0.0]\n'


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot(physics_dt_s=0.02)


def take(
    bag: Path, capsys: pytest.CaptureFixture[str], text: str = MAP
) -> tuple[dict[str, Any], list[Episode]]:
    """What was reported, and the episodes in their order."""
    code, out, error = run(bag, capsys, text)
    assert code == 0, error
    dataset = Dataset.open(bag.parent / "set")
    episodes = [dataset.read(entry.sha256) for entry in dataset.entries()]
    episodes.sort(key=lambda episode: episode.meta.env_index)
    return json.loads(out), episodes


def run(
    bag: Path, capsys: pytest.CaptureFixture[str], text: str = MAP
) -> tuple[int, str, str]:
    place = bag.parent / "map.toml"
    place.write_text(text)
    into = ["--map", str(place), "--dataset", str(bag.parent / "set"), "--json"]
    code = main(["data", "import", "ros2", str(bag), *into])
    printed = capsys.readouterr()
    return code, printed.out, printed.err


def off(found: Episode, truth: Episode, name: str) -> float:
    """Root mean square difference of a feature, of the steps both have."""
    count = min(found.num_steps, truth.num_steps)
    part = column(name)
    error = found.features[:count, part] - truth.features[:count, part]
    return float(np.sqrt(np.mean(error**2)))


@pytest.mark.parametrize(
    ("storage", "packed"),
    [
        ("MCAP", "NONE"),
        ("MCAP", "FILE"),
        ("SQLITE3", "NONE"),
        ("SQLITE3", "FILE"),
        ("SQLITE3", "MESSAGE"),
    ],
)
def test_a_bag_comes_in_as_it_is(
    tmp_path: Path,
    robot: Robot,
    capsys: pytest.CaptureFixture[str],
    storage: str,
    packed: str,
) -> None:
    """The folder that ROS calls a bag, however it is stored and packed."""
    truth = walked()[0]
    topics = ("/joint_states", "/odom")
    bag = write_rosbag(
        tmp_path / "bag", truth, robot, topics, storage=storage, packed=packed
    )
    told, (found,) = take(bag, capsys)
    assert (told["told"], told["left_out"]) == ([], {})
    assert found.num_steps == truth.num_steps
    assert off(found, truth, "base_lin_vel_b") < 0.02
    assert off(found, truth, "joint_vel") < 1e-3
    assert off(found, truth, "gravity_b") < 0.01
    assert found.meta.extra["estimated_features"] == ""


def test_unitrees_own_messages_are_read(
    tmp_path: Path, robot: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    """Joints, torques, gyroscope and feet of LowState, the place of SportModeState."""
    truth = walked()[1]
    topics = ("/lowstate", "/sportmodestate")
    bag = write_rosbag(tmp_path / "bag", truth, robot, topics, storage="SQLITE3")
    text = f'{MAP}[joints]\ntopic = "/lowstate"\n[base]\ntopic = "/sportmodestate"\n'
    text += '[contacts]\ntopic = "/lowstate"\nfield = "foot_force"\nabove = 20.0\n'
    told, (found,) = take(bag, capsys, text)
    assert told["missing"] == ["action", "action_rate"]
    assert off(found, truth, "base_lin_vel_b") < 0.02
    assert off(found, truth, "joint_vel") < 1e-3
    assert off(found, truth, "base_ang_vel_b") < 1e-4
    assert np.all(found.features[:, column("joint_torque")] == 2.5)
    assert np.all(found.features[:, column("foot_contact")] == [1, 0, 1, 0])


@pytest.mark.parametrize(
    ("topics", "tables"),
    [
        (("/joint_states", "/imu/data"), '[imu]\ntopic = "/imu/data"\n'),
        (("/lowstate",), '[joints]\ntopic = "/lowstate"\n'),
        (("/joint_states", "/odom", "/imu/data"), "[base]\nfrom_legs = true\n[imu]\n"),
    ],
)
def test_without_an_odometry_the_legs_tell_of_the_base(
    tmp_path: Path,
    robot: Robot,
    capsys: pytest.CaptureFixture[str],
    topics: tuple[str, ...],
    tables: str,
) -> None:
    """To 7 % of the speed and 1 cm of the height, and said to be estimated."""
    truth = max(walked(), key=lambda episode: episode.meta.command[0])
    bag = write_rosbag(tmp_path / "bag", truth, robot, topics)
    told, (found,) = take(bag, capsys, MAP + tables)
    assert any("are estimated from the legs" in line for line in told["told"])
    assert told["estimated"] == ["base_height", "base_lin_vel_b"]
    assert "base_height" in found.meta.extra["estimated_features"]
    count = min(found.num_steps, truth.num_steps)
    part = column("base_lin_vel_b")
    error = found.features[:count, part] - truth.features[:count, part]
    speed = np.sqrt(np.mean(truth.features[:, part][:, 0] ** 2))
    assert np.sqrt(np.mean(error[:, 0] ** 2)) < 0.07 * speed
    assert np.sqrt(np.mean(error[:, 1] ** 2)) < 0.04
    # A drift would show in the mean.
    assert np.abs(error[:, :2].mean(axis=0)).max() < 0.02
    assert off(found, truth, "base_height") < 0.01
    touch = column("foot_contact")
    same = found.features[:count, touch] == truth.features[:count, touch]
    assert same.mean() > 0.85


def test_joints_that_are_named_otherwise_are_listed_with_a_guess(
    tmp_path: Path, robot: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    """The guess is a line for the map, and fits."""
    names = [
        f"{leg}_{part}"
        for leg in ("RF", "LF", "RH", "LH")
        for part in ("HAA", "HFE", "KFE")
    ]
    topics = ("/joint_states", "/odom")
    bag = write_rosbag(tmp_path / "bag", walked()[0], robot, topics, names=names)
    code, _, error = run(bag, capsys)
    assert code == 2
    assert "its joints are LF_HAA, LF_HFE" in error
    line = "names = " + error.partition("names = ")[2].partition("]")[0] + "]"
    assert json.loads(line.removeprefix("names = ")) == names
    _, (found,) = take(bag, capsys, f"{MAP}[joints]\n{line}\n")
    assert off(found, walked()[0], "joint_vel") < 1e-3


def test_no_place_and_no_attitude_is_said(
    tmp_path: Path, robot: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_rosbag(tmp_path / "bag", walked()[0], robot, ("/joint_states",))
    code, _, error = run(bag, capsys)
    assert code == 2
    assert "holds no message on /odom" in error
    assert "an IMU with its attitude in [imu]" in error
    code, _, error = run(bag, capsys, MAP.replace('robot = "go1"\n', ""))
    assert code == 2
    assert "does not say which robot the log is of" in error


def in_sqlite(tmp_path: Path, robot: Robot) -> tuple[Path, Path]:
    """A sound bag and the file in it."""
    topics = ("/joint_states", "/odom")
    bag = write_rosbag(tmp_path / "bag", walked()[0], robot, topics, storage="SQLITE3")
    return bag, next(bag.glob("*.db3"))


@pytest.mark.parametrize(
    ("statement", "reason"),
    [
        ("DROP TABLE topics", "it has no tables of topics and messages"),
        ("UPDATE topics SET serialization_format = 'json'", "not in cdr"),
        ("UPDATE messages SET data = 'text'", "is no message"),
        ("UPDATE messages SET timestamp = 'now'", "is no message"),
        ("UPDATE topics SET name = 1.5", "holds no message on"),
        (
            "ALTER TABLE messages RENAME TO old; CREATE VIEW messages AS WITH "
            "RECURSIVE r(x) AS (SELECT 1 UNION ALL SELECT x FROM r) SELECT x AS id, "
            "1 AS topic_id, 1 AS timestamp, zeroblob(9) AS data FROM r",
            "it has no tables of topics and messages",
        ),
        ("UPDATE messages SET data = zeroblob(300000000)", "breaks off or is damaged"),
        (
            "UPDATE messages SET data = x'28b52ffd0458000000'",
            "before any message that is asked for",
        ),
    ],
)
def test_a_hostile_sqlite_file_is_refused(
    tmp_path: Path,
    robot: Robot,
    capsys: pytest.CaptureFixture[str],
    statement: str,
    reason: str,
) -> None:
    bag, place = in_sqlite(tmp_path, robot)
    if "zeroblob(3" in statement:
        statement += " WHERE id = 1"
    with closing(sqlite3.connect(place)) as store:
        store.executescript(statement)
    code, _, error = run(bag, capsys)
    assert code == 2
    assert reason in error
    assert len(error.splitlines()) == 1


def test_a_packed_bomb_is_refused(
    tmp_path: Path,
    robot: Robot,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A file that unpacks to more than the limit, here a small one."""
    monkeypatch.setattr("gaitpref.formats.ros2.bag_files.BAG_FILE_BYTES", 10_000)
    bag = tmp_path / "walk.mcap.zstd"
    bag.write_bytes(zstandard.compress(bytes(5_000_000)))
    code, _, error = run(bag, capsys)
    assert code == 2
    assert "is packed with zstd, and it claims to unpack to" in error
    assert not list(tmp_path.glob("set*"))


@pytest.mark.parametrize(
    ("kind", "definition", "content", "reason"),
    [
        ("sensor_msgs/msg/JointState", "int8 id\n", {"id": 1}, "as ROS has it"),
        (
            "unitree_go/msg/LowState",
            "unitree_go/M[2] motor_state\nunitree_go/I imu_state\n"
            f"{'=' * 80}\nMSG: unitree_go/M\nfloat32 q\nfloat32 dq\nfloat32 tau_est\n"
            f"{'=' * 80}\nMSG: unitree_go/I\nfloat32[4] quaternion\n"
            "float32[3] gyroscope\n",
            {
                "motor_state": [{"q": 0.0, "dq": 0.0, "tau_est": 0.0}] * 2,
                "imu_state": {"quaternion": [1.0, 0, 0, 0], "gyroscope": [0.0, 0, 0]},
            },
            "tells 2 numbers of position, it has 12",
        ),
        ("std_msgs/msg/String", "string data\n", {"data": "x"}, "the joints are read"),
    ],
)
def test_a_type_that_is_not_what_it_is_called_is_refused(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    kind: str,
    definition: str,
    content: dict[str, Any],
    reason: str,
) -> None:
    """A bag brings its own definitions."""
    bag = tmp_path / "walk.mcap"
    with bag.open("wb") as file, Writer(file) as writer:
        schema = writer.register_msgdef(kind, definition)
        for ns in range(9):
            writer.write_message("/joint_states", schema, content, ns, ns)
    code, _, error = run(bag, capsys)
    assert code == 2
    assert reason in error
    assert len(error.splitlines()) == 1
