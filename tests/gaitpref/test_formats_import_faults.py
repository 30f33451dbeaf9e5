"""What is wrong in a bag is left out and counted, told, or refused; never mixed in."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk
from mcap.writer import MCAP0_MAGIC

from data.datasets.dataset import Dataset
from data.episodes.episode import Episode
from data.features import JOINTS, column
from gaitpref.cli.main import main
from policy.robots.robot import Robot, load_robot

pytest.importorskip("mcap_ros2.writer", reason="needs the extra `view`")

from gaitpref.formats.viewers.messages import header
from tests.helpers.ros2_bag import START_S, Alter, Motion, write_bag

NAMES = [f"{joint.lower()}_joint" for joint in JOINTS]
MAP = f"""
robot = "go1"
[joints]
names = {json.dumps(NAMES)}
[base]
topic = "/base"
"""
NAN = float("nan")


@dataclass(frozen=True)
class Bench:
    """Imports bags into data sets of a directory."""

    root: Path
    motion: Motion
    capsys: pytest.CaptureFixture[str]

    def write(self, alter: Alter | None = None, **how: Any) -> Path:
        """A bag of 4 s in which `alter` made something wrong."""
        path = self.root / "walk.mcap"
        changes: dict[str, Any] = {} if alter is None else {"alter": alter}
        settings: dict[str, Any] = {"duration_s": 4.0}
        write_bag(path, self.motion, NAMES, **(settings | changes | how))
        return path

    def run(self, bag: Path, text: str = MAP) -> tuple[int, str, str]:
        """Exit code and what was printed."""
        (self.root / "map.toml").write_text(text)
        into = ["--map", str(self.root / "map.toml"), "--json"]
        command = ["data", "import", "ros2", str(bag), *into]
        code = main([*command, "--dataset", str(self.root / "set")])
        printed = self.capsys.readouterr()
        return code, printed.out, printed.err

    def take(self, bag: Path, text: str = MAP) -> tuple[dict[str, Any], list[Episode]]:
        """What was reported, and the episodes in their order."""
        code, out, error = self.run(bag, text)
        assert code == 0, error
        dataset = Dataset.open(self.root / "set")
        episodes = [dataset.read(entry.sha256) for entry in dataset.entries()]
        episodes.sort(key=lambda episode: episode.meta.env_index)
        return json.loads(out), episodes

    def refuse(self, bag: Path, text: str = MAP) -> str:
        """The line that says why."""
        code, _, error = self.run(bag, text)
        assert code == 2
        assert len(error.splitlines()) == 1
        assert not (self.root / "set").exists()
        return error


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot(physics_dt_s=0.02)


@pytest.fixture
def bench(tmp_path: Path, robot: Robot, capsys: pytest.CaptureFixture[str]) -> Bench:
    return Bench(tmp_path, Motion(robot), capsys)


def stamped(message: dict[str, Any], time_s: float) -> dict[str, Any]:
    return message | {"header": header(round(time_s * 1e9), "odom")}


def turned(message: dict[str, Any], factor: float) -> dict[str, Any]:
    """A pose whose quaternion is `factor` times as long."""
    pose = message["pose"]
    longer = {name: factor * v for name, v in pose["orientation"].items()}
    return message | {"pose": pose | {"orientation": longer}}


def moved(message: dict[str, Any], x_m: float) -> dict[str, Any]:
    pose = message["pose"]
    place = pose["position"] | {"x": pose["position"]["x"] + x_m}
    return message | {"pose": pose | {"position": place}}


@pytest.mark.parametrize("phase_s", [0.0, 0.007])
def test_time_that_starts_anew_is_another_episode(bench: Bench, phase_s: float) -> None:
    """A bag played in a loop: the second pass, 50 m on, is not mixed into the first."""

    def alter(t: float, topic: str, message: dict[str, Any]) -> list[dict[str, Any]]:
        second = t >= 2.2
        message = stamped(message, 1.0 + t - (2.2 - phase_s if second else 0.0))
        return [moved(message, 50.0) if second and topic == "/base" else message]

    told, episodes = bench.take(bench.write(alter, duration_s=4.6))
    assert told["stretches"] == len(episodes) == 2
    assert "the clock goes back, 1 times" in told["told"][0]
    for episode in episodes:
        assert np.abs(np.diff(episode.qpos[:, 0])).max() < 0.03
        speed = episode.features[:, column("base_lin_vel_b")]
        assert np.abs(speed).max() < 1.2
    first, second = (episode.qpos[:, 0] for episode in episodes)
    assert first.max() < 2.2 * 0.6 + 0.01
    assert second.min() > 50 + 2.2 * 0.6 - 0.01
    assert len(first) + len(second) > 4.4 / 0.02
    assert told["left_out"] == {}


def test_what_has_no_stamp_is_placed_by_the_clock_of_the_joints(bench: Bench) -> None:
    """Commands have no header; stamps are of a simulation that began at 0."""

    def alter(t: float, topic: str, message: dict[str, Any]) -> list[dict[str, Any]]:
        if topic == "/cmd_vel":
            speed = {"x": 0.2 if t < 3 else 0.8, "y": 0.0, "z": 0.0}
            return [message | {"linear": speed}]
        return [stamped(message, t)] if "header" in message else [message]

    text = MAP + '[twist]\ntopic = "/cmd_vel"\n'
    told, (episode,) = bench.take(bench.write(alter, full=True), text)
    asked = episode.features[:, column("command")][:, 0]
    when_s = episode.qpos[1:, 0] / 0.6
    assert asked[when_s < 2.95] == pytest.approx(0.2)
    assert asked[when_s > 3.05] == pytest.approx(0.8)
    assert told["told"] == []


def test_a_few_wrong_stamps_are_left_out(bench: Bench) -> None:
    """One that leapt, one that nobody filled in; all of them: the recorder's time."""

    sent = 0

    def some(t: float, topic: str, message: dict[str, Any]) -> list[dict[str, Any]]:
        nonlocal sent
        sent += topic == "/joint_states"
        if topic == "/joint_states" and sent in (200, 400):
            return [stamped(message, 2.1e9 if sent == 200 else 0.0)]
        return [message]

    told, episodes = bench.take(bench.write(some))
    assert len(episodes) == 1
    assert told["left_out"] == {
        "/joint_states without a stamp": 1,
        "/joint_states stamped far from their neighbours": 1,
    }

    def none(t: float, topic: str, message: dict[str, Any]) -> list[dict[str, Any]]:
        return [stamped(message, 0.0) if topic == "/joint_states" else message]

    told, again = bench.take(bench.write(none))
    assert len(again) == 2, "the first import's and this one's"
    assert "/joint_states has no stamps" in told["told"][0]


def test_two_clocks_are_told(bench: Bench) -> None:
    def alter(t: float, topic: str, message: dict[str, Any]) -> list[dict[str, Any]]:
        return [stamped(message, START_S + t + 1) if topic == "/base" else message]

    told, _ = bench.take(bench.write(alter))
    assert "are 1 s apart at the same moment" in told["told"][0]

    def far(t: float, topic: str, message: dict[str, Any]) -> list[dict[str, Any]]:
        return [stamped(message, 5 + t) if topic == "/base" else message]

    (bench.root / "set").rename(bench.root / "other")
    error = bench.refuse(bench.write(far))
    assert "/base from 5.0" in error
    assert 'time = "log"' in error


def test_samples_that_are_not_finite_are_left_out_and_counted(bench: Bench) -> None:
    """The driver has read nothing yet, and loses a value now and then."""
    sent = 0

    def alter(t: float, topic: str, message: dict[str, Any]) -> list[dict[str, Any]]:
        nonlocal sent
        if topic == "/base":
            return [moved(message, NAN) if 1.0 < t < 1.0101 else message]
        if topic != "/joint_states":
            return [message]
        sent += 1
        changed = dict(message)
        if sent <= 3 or sent == 100:
            changed["position"] = [NAN] * 13
        if sent == 200:
            changed["velocity"] = [*message["velocity"][:5], 1e300] + [0.0] * 7
        if sent == 300:
            changed["effort"] = []
        return [changed]

    told, (episode,) = bench.take(bench.write(alter, full=True))
    assert told["left_out"] == {
        "/joint_states position not finite or above 1e+09": 4,
        "/joint_states velocity not finite or above 1e+09": 1,
        "/joint_states without a effort": 1,
        "/base pose not finite or above 1e+09": 1,
    }
    assert episode.meta.extra["missing_features"] == "command action action_rate"
    assert "joint_vel" not in episode.meta.extra["derived_features"]
    t = episode.qpos[1:, 0] / 0.6
    error = episode.features[:, column("joint_vel")] - bench.motion.joint_vel(t)
    assert np.sqrt(np.mean(error**2)) < 0.02 * 1.2 * np.pi


def test_a_long_silence_of_numbers_ends_an_episode(bench: Bench) -> None:
    """0.5 s of positions that are not finite do; of torques, they are missing there."""

    def alter(t: float, topic: str, message: dict[str, Any]) -> list[dict[str, Any]]:
        if topic != "/joint_states":
            return [message]
        changed = dict(message)
        if 1.5 < t < 2.0:
            changed["position"] = [NAN] * 13
        if 2.8 < t < 3.3:
            changed["effort"] = [NAN] * 13
        return [changed]

    told, episodes = bench.take(bench.write(alter, full=True))
    assert told["stretches"] == len(episodes) == 2
    assert told["left_out"]["/joint_states position not finite or above 1e+09"] > 70
    first, second = (episode.meta.extra["missing_features"] for episode in episodes)
    assert "joint_torque" not in first
    assert "joint_torque" in second


def test_quaternions_are_made_of_length_1_or_left_out(bench: Bench) -> None:
    """Within 1 % they are rounded; others are no attitude."""

    def alter(t: float, topic: str, message: dict[str, Any]) -> list[dict[str, Any]]:
        if topic != "/base":
            return [message]
        if 1.0 < t < 1.05:
            return [turned(message, 0.0)]
        return [turned(message, 2.01 if 3.0 < t < 3.05 else 1.009)]

    told, (episode,) = bench.take(bench.write(alter))
    kinds = sorted(told["left_out"])
    assert kinds == [
        "/base quaternion all zero",
        "/base quaternion of length 2.01 to 2.01 in place of 1",
    ]
    assert all(2 <= told["left_out"][kind] <= 6 for kind in kinds)
    for rows in (
        episode.qpos[:, 3:7],
        episode.features[:, column("gravity_b")],
    ):
        assert np.linalg.norm(rows, axis=1) == pytest.approx(1.0, abs=1e-6)
    t = episode.qpos[1:, 0] / 0.6
    speed = episode.features[:, column("base_lin_vel_b")]
    assert speed == pytest.approx(bench.motion.lin_vel_b(t), abs=0.05)


@pytest.mark.parametrize(
    ("factor", "reason"),
    [
        (0.0, "quaternion all zero: "),
        (2.0, "quaternion of length 2 to 2 in place of 1"),
    ],
)
def test_a_bag_without_an_attitude_is_refused(
    bench: Bench, factor: float, reason: str
) -> None:
    def alter(t: float, topic: str, message: dict[str, Any]) -> list[dict[str, Any]]:
        return [turned(message, factor) if topic == "/base" else message]

    error = bench.refuse(bench.write(alter))
    assert "/base tells no pose that can be used" in error
    assert reason in error


@pytest.mark.parametrize("topic", ["/joint_states", "/base"])
def test_two_publishers_on_a_topic_are_refused(bench: Bench, topic: str) -> None:
    """A node that knows nothing publishes zeros, or another place, beside the robot."""

    def alter(t: float, found: str, message: dict[str, Any]) -> list[dict[str, Any]]:
        other = stamped(message, START_S + t + 0.002)
        if found != topic:
            return [message]
        if topic == "/base":
            return [message, moved(other, 3.0)]
        return [message, other | {"position": [0.0] * 13}]

    error = bench.refuse(bench.write(alter))
    assert f"{topic} goes to and fro" in error
    assert "two publishers" in error


def test_joints_that_are_too_fast_are_told(bench: Bench) -> None:
    """One message in forty is zeros: too few for a second publisher."""
    sent = 0

    def alter(t: float, topic: str, message: dict[str, Any]) -> list[dict[str, Any]]:
        nonlocal sent
        sent += topic == "/joint_states"
        zeros = topic == "/joint_states" and sent % 40 == 0
        return [message | {"position": [0.0] * 13} if zeros else message]

    told, _ = bench.take(bench.write(alter))
    line = told["told"][0]
    assert line.startswith("joint_vel up to ")
    assert "rad a step" in line


def test_a_base_that_leaps_and_joints_beyond_their_limits_are_told(
    bench: Bench,
) -> None:
    """A place found anew by a map, and angles in degrees."""

    def alter(t: float, topic: str, message: dict[str, Any]) -> list[dict[str, Any]]:
        if topic == "/base":
            return [moved(message, 3.0 if t > 3 else 0.0)]
        degrees = np.degrees(message["position"]).tolist()
        return [message | {"position": degrees}]

    told, _ = bench.take(bench.write(alter))
    text = "\n".join(told["told"])
    assert "the base moves at up to" in text
    assert "that of go1 from -2.82 to -0.89: is it the robot" in text
    assert "joint_vel up to " in text


def test_nothing_is_told_of_a_bag_that_is_sound(bench: Bench) -> None:
    told, _ = bench.take(bench.write(full=True))
    assert told["left_out"] == {}
    assert told["told"] == []


def test_a_map_without_a_robot_asks_for_one(bench: Bench) -> None:
    error = bench.refuse(bench.write(), MAP.replace('robot = "go1"', ""))
    assert "does not say which robot" in error
    assert 'robot = "ROBOT.xml"' in error


def test_joints_called_otherwise_are_listed(bench: Bench) -> None:
    error = bench.refuse(bench.write(), MAP.replace("fl_calf", "fl_shin"))
    assert "its joints are fl_calf_joint, fl_hip_joint" in error
    assert "wants fl_shin_joint" in error


def test_topics_of_another_kind_are_named(bench: Bench) -> None:
    bag = bench.write(full=True)
    swapped = MAP.replace('"/base"', '"/joint_states"').replace(
        "[joints]", '[joints]\ntopic = "/base"'
    )
    assert "/joint_states is sensor_msgs/msg/JointState; the base is read from" in (
        bench.refuse(bag, swapped)
    )
    feet = MAP + '[contacts]\ntopic = "/feet"\nfield = "forces"\n'
    assert "/feet has no four values in 'forces'" in bench.refuse(bag, feet)
    frames = MAP + 'frame = "map"\nchild = "belly"\n'
    error = bench.refuse(bench.write(base="tf"), frames)
    assert "no transform from map to belly" in error


def test_an_unfinished_file_is_read_as_far_as_it_goes(bench: Bench) -> None:
    """Cut within a chunk, without an end; damaged in a chunk, with its end."""
    bag = bench.write(chunk_bytes=10_000)
    content = bag.read_bytes()
    _, (whole,) = bench.take(bag)
    damaged = bytearray(content)
    damaged[len(content) // 2] ^= 0xFF
    for number, broken in enumerate((content[: len(content) // 2], bytes(damaged))):
        (bench.root / "set").rename(bench.root / f"{number}")
        bag.write_bytes(broken)
        told, (part,) = bench.take(bag)
        assert "breaks off or is damaged" in told["told"][0]
        assert 0.3 * whole.num_steps < part.num_steps < 0.7 * whole.num_steps
        # At its end, velocities are fitted to fewer samples.
        same = part.num_steps - 5
        moved = part.qpos[:same] - whole.qpos[:same]
        # Less of it tells a little less of where the ground is.
        assert np.ptp(moved[:, 2]) < 1e-6
        assert abs(moved[0, 2]) < 1e-3
        moved[:, 2] = 0.0
        assert moved == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "is empty, 0 bytes"),
        (b"\x89MCAP0\r\n", "within its 8 bytes, before any message"),
        (b"SQLite format 3\0" + bytes(100), "breaks off or is damaged"),
        (b"\x28\xb5\x2f\xfd" + b"\xff" * 100, "is packed with zstd, and it does not"),
        (b"#ROSBAG V2.0\n" + bytes(100), "a bag of ROS 1"),
        (b"PK\x03\x04" + bytes(100), "begins with b'PK"),
    ],
)
def test_what_is_no_bag_is_named(bench: Bench, content: bytes, reason: str) -> None:
    bag = bench.root / "walk.mcap"
    bag.write_bytes(content)
    assert reason in bench.refuse(bag)


def in_two_files(bench: Bench, folder: Path) -> Path:
    """A bag as a folder: what was recorded before 2.2 s in walk_10, after in walk_9."""
    folder.mkdir()
    for name, first in (("walk_10.mcap", True), ("walk_9.mcap", False)):
        bag = bench.write(
            lambda t, _, m, first=first: [m] if (t < 2.2) == first else []
        )
        bag.rename(folder / name)
    return folder


def listing(names: list[str]) -> str:
    return "rosbag2_bagfile_information:\n  relative_file_paths:\n" + "".join(
        f"    - {name}\n" for name in names
    )


def test_a_bag_that_is_a_folder_is_taken_in_the_order_of_its_metadata(
    bench: Bench,
) -> None:
    """One stretch over both files; a folder without metadata was cut off."""
    one = in_two_files(bench, bench.root / "bag")
    names = listing(["bag/walk_10.mcap", "walk_9.mcap"])
    (one / "metadata.yaml").write_text(names)
    told, (episode,) = bench.take(one)
    assert told["told"] == []
    assert episode.num_steps > 3.9 / 0.02
    assert episode.meta.extra["log"] == "bag"
    (one / "metadata.yaml").unlink()
    told, _ = bench.take(one)
    assert "its recording was not finished: its 2 files" in told["told"][0]


@pytest.mark.parametrize(
    ("metadata", "reason"),
    [
        (listing(["walk_0.bag"]), "holds walk_0.bag; the files of a ROS 2 bag end in"),
        (listing(["w.mcap.zstd"]), "names w.mcap.zstd, missing in the folder"),
        (listing(["w_0.mcap"]), "names w_0.mcap, missing in the folder"),
        ("- 1\n", "does not list the files of the bag"),
        ("{", "does not list the files of the bag"),
        (None, "holds no .mcap or .db3"),
    ],
)
def test_a_folder_that_is_no_bag_is_named(
    bench: Bench, metadata: str | None, reason: str
) -> None:
    folder = bench.root / "bag"
    folder.mkdir()
    if metadata is not None:
        (folder / "metadata.yaml").write_text(metadata)
    assert reason in bench.refuse(folder)


def test_what_is_told_of_a_bag_does_not_act_on_the_terminal(bench: Bench) -> None:
    """Names of its files are a stranger's, and stand in the notes."""
    sound = bench.write(chunk_bytes=10_000).read_bytes()
    bag = bench.root / "wa\x1b[31mlk.mcap"
    bag.write_bytes(sound[: len(sound) * 3 // 4])
    (bench.root / "map.toml").write_text(MAP)
    command = ["data", "import", "ros2", str(bag)]
    command += ["--map", str(bench.root / "map.toml")]
    assert main([*command, "--dataset", str(bench.root / "set")]) == 0
    said = bench.capsys.readouterr()
    assert "note: " in said.out
    assert "wa\\x1b[31mlk.mcap breaks off" in said.out
    assert "\x1b" not in said.out + said.err


BOMBS = {
    "zstd": lambda size: zstandard.compress(bytes(size), 19),
    "lz4": lambda size: lz4.frame.compress(bytes(size)),
}
MOST_MEMORY_BYTES = 2**30


@pytest.mark.parametrize("compression", BOMBS)
@pytest.mark.parametrize("claimed", [1000, 10**12])
def test_a_chunk_that_unpacks_to_gigabytes_costs_no_memory(
    tmp_path: Path, compression: str, claimed: int
) -> None:
    """Whatever it claims, with an index or without: one line, and little memory."""
    (tmp_path / "map.toml").write_text(MAP)
    packed = BOMBS[compression](2 * 2**30)
    assert len(packed) < 2**24
    builder = RecordBuilder()
    Chunk(compression, packed, 0, 0, 0, claimed).write(builder)
    path = tmp_path / "bomb.mcap"
    path.write_bytes(MCAP0_MAGIC + builder.end())
    command = ["data", "import", "ros2", str(path), "--map"]
    command += [str(tmp_path / "map.toml"), "--dataset", str(tmp_path / "set")]
    code = (
        "import resource, sys\n"
        f"resource.setrlimit(resource.RLIMIT_DATA, ({MOST_MEMORY_BYTES},) * 2)\n"
        "from gaitpref.cli.main import main\n"
        "sys.exit(main(sys.argv[1:]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *command],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1
    assert "claims to unpack" in done.stderr
