"""ROS 2 bags come in as episodes that are judged and fitted beside simulated ones."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from data.answers.answer_records import Answer, Pair
from data.datasets.dataset import Dataset
from data.datasets.verify import verify
from data.episodes.clips import Clip
from data.episodes.episode import Episode
from data.features import JOINTS, column, missing_features
from gaitpref.cli.main import main
from labeling_ui.page.footfall_svg import curves, footfalls
from labeling_ui.scene.clip_motion import load_motion
from policy.robots.robot import Robot, load_robot
from rewardmodel.answers.answered_pairs import load_pairs
from rewardmodel.cfg import FitCfg
from rewardmodel.fitting.fit_reward import fit_reward
from tests.helpers.motion import trot

pytest.importorskip("mcap_ros2.writer", reason="needs the extra `view`")

from tests.helpers.ros2_bag import Motion, write_bag

NAMES = [f"{joint.lower()}_joint" for joint in JOINTS]
MAP = f"""
robot = "go1.xml"
command = [0.5, 0.0, 0.0]
[joints]
names = {json.dumps(NAMES)}
[base]
topic = "/base"
"""


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot(physics_dt_s=0.02)


@pytest.fixture(scope="module")
def motion(robot: Robot) -> Motion:
    return Motion(robot)


def imported(
    root: Path, motion: Motion, robot: Robot, text: str = MAP, **how: object
) -> tuple[Dataset, list[Episode]]:
    """Write a bag and its map, import them; the episodes in their order of time."""
    write_bag(root / "walk.mcap", motion, NAMES, **how)  # type: ignore[arg-type]
    (root / "map.toml").write_text(text)
    (root / "go1.xml").write_text(robot.mjcf)
    into = ["--map", str(root / "map.toml"), "--dataset", str(root / "set")]
    command = ["data", "import", "ros2", str(root / "walk.mcap"), *into]
    assert main(command) == 0
    dataset = Dataset.open(root / "set")
    episodes = [dataset.read(entry.sha256) for entry in dataset.entries()]
    return dataset, sorted(episodes, key=lambda episode: episode.meta.env_index)


def times_of(episode: Episode) -> np.ndarray:
    """When the rows are, out of the distance walked: the base moves at 0.6 m/s."""
    return episode.qpos[1:, 0] / 0.6


def worst(found: np.ndarray, expected: np.ndarray) -> float:
    """Root mean square error as a share of the largest value."""
    return float(np.sqrt(np.mean((found - expected) ** 2)) / np.abs(expected).max())


@pytest.mark.parametrize("base", ["pose", "odometry", "tf"])
def test_velocities_are_right_to_2_percent(
    base: str, tmp_path: Path, motion: Motion, robot: Robot
) -> None:
    """Of joints and base, from positions alone, over jitter and losses."""
    _, episodes = imported(tmp_path, motion, robot, base=base)
    assert len(episodes) == 2, "0.8 s without a message end an episode, 0.1 s do not"
    assert sum(episode.num_steps for episode in episodes) == pytest.approx(360, abs=8)
    for episode in episodes:
        t = times_of(episode)
        np.testing.assert_allclose(np.diff(t), 0.02, atol=2e-4)
        for name, expected in (
            ("joint_vel", motion.joint_vel(t)),
            ("base_lin_vel_b", motion.lin_vel_b(t)),
            ("base_ang_vel_b", motion.ang_vel_b(t)),
        ):
            assert worst(episode.features[:, column(name)], expected) < 0.02, name
        offsets = np.array([motion.joint_pos(time) for time in t])
        found = episode.features[:, column("joint_pos_offset")] + robot.home_joint_pos
        assert worst(found, offsets) < 0.005
        np.testing.assert_allclose(episode.qvel[1:, 6:], motion.joint_vel(t), atol=0.2)


def test_what_nobody_measured_is_missing_and_not_zero(
    tmp_path: Path, motion: Motion, robot: Robot
) -> None:
    """Torque and action; contacts come from the feet, whose ground is below them."""
    _, episodes = imported(tmp_path, motion, robot)
    rows = episodes[0].features
    assert missing_features(rows) == ("joint_torque", "action", "action_rate")
    assert np.isnan(rows[:, column("joint_torque")]).all()
    extra = episodes[0].meta.extra
    assert extra["missing_features"] == "joint_torque action action_rate"
    assert "foot_contact" in extra["derived_features"]
    height = rows[:, column("foot_height")]
    assert abs(np.percentile(height.min(axis=1), 35)) < 0.002
    contact = rows[:, column("foot_contact")]
    assert np.array_equal(contact, height < 0.01)
    assert 0.02 < contact.mean() < 0.98
    air_s = rows[:, column("foot_air_time")]
    assert (air_s[contact > 0] == 0).all()
    assert (air_s[contact == 0] > 0).all()
    assert 0.15 < rows[:, column("base_height")].mean() < 0.5


def test_what_the_driver_tells_is_taken(
    tmp_path: Path, motion: Motion, robot: Robot
) -> None:
    """Velocities, gyroscope, torques, forces at the feet and commands."""
    text = MAP.replace("command = [0.5, 0.0, 0.0]\n", "") + (
        '[imu]\ntopic = "/imu"\n[twist]\ntopic = "/cmd_vel"\n'
        '[contacts]\ntopic = "/feet"\norder = ["RL", "RR", "FL", "FR"]\nabove = 20.0\n'
    )
    dataset, episodes = imported(
        tmp_path, motion, robot, text, base="odometry", full=True
    )
    first = episodes[0]
    rows, t = first.features, times_of(first)
    assert missing_features(rows) == ("action", "action_rate")
    assert rows[0, column("joint_torque")] == pytest.approx(np.arange(12) + 1.0)
    assert worst(rows[:, column("joint_vel")], motion.joint_vel(t)) < 0.02
    assert worst(rows[:, column("base_ang_vel_b")], motion.ang_vel_b(t)) < 0.02
    assert first.meta.extra["derived_features"] == ""
    contact = rows[:, column("foot_contact")]
    assert contact[t < 3.9].tolist() == [[1, 0, 0, 1]] * int((t < 3.9).sum())
    assert contact[t > 4.2].tolist() == [[0, 0, 0, 1]] * int((t > 4.2).sum())
    assert dataset.entries()[0].meta.command == (0.5, 0.0, 0.0)


def test_hardware_is_judged_and_fitted_beside_simulation(
    tmp_path: Path, motion: Motion, robot: Robot
) -> None:
    """The page plays both clips of a mixed pair, and the reward knows both."""
    dataset, _ = imported(tmp_path, motion, robot)
    hardware = [entry.sha256 for entry in dataset.entries()]
    sims = [
        replace(trot(robot, steps), qpos=trot(robot, steps).qpos) for steps in (90, 95)
    ]
    simulated = [entry.sha256 for entry in dataset.add_episodes(sims)]
    sources = {"hardware": hardware, "simulated": simulated}
    rng = np.random.default_rng(0)

    def clip(source: str) -> Clip:
        sha256 = str(rng.choice(sources[source]))
        return Clip(sha256, int(rng.integers(0, 40)), 40)

    kinds = [("hardware", "simulated"), ("simulated", "hardware")] * 6
    kinds += [("hardware", "hardware"), ("simulated", "simulated")] * 4
    pairs = [Pair.make(clip(a), clip(b), strategy="u", round=0) for a, b in kinds]
    with dataset.answers() as store:
        store.add_rater("ada", "human")
        store.add_pairs(pairs)
        for number, pair in enumerate(pairs):
            store.add_answer(
                Answer(
                    answer_id=str(number),
                    pair_id=pair.pair_id,
                    rater_id="ada",
                    choice="a" if number % 3 else "b",
                    shown_left="a",
                    created_utc="2030-01-31T12:00:00Z",
                )
            )
    assert not verify(dataset.root).damages
    left, right = (load_motion(dataset, c) for c in (pairs[0].a, pairs[0].b))
    assert np.isfinite(left.positions).all()
    assert np.abs(left.path[0]).max() < 0.05
    page = curves(left, right, 0.8) + footfalls(left, right, 0.8)
    assert "nan" not in page
    assert page.count("<polyline") == 5, "no curve of a torque nobody measured"
    assert "not measured" in curves(left, left, 0.8)
    model, report = fit_reward(load_pairs([dataset]), FitCfg(), seed=0)
    assert report.answers == len(pairs)
    assert all(torch.isfinite(value).all() for value in model.state_dict().values())


def test_bags_that_cannot_be_used_are_refused_in_one_line(
    tmp_path: Path, motion: Motion, robot: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    """Topics, joints, files and maps that are not what they should be."""
    imported(tmp_path, motion, robot, duration_s=2.0)
    capsys.readouterr()
    (tmp_path / "noise.mcap").write_bytes(b"noise" * 100)
    for bag, text, message in (
        ("walk.mcap", MAP.replace('"/base"', '"/odom"'), "no message on /odom"),
        ("walk.mcap", MAP.replace("fl_calf", "fl_toe"), "no message on /joint_states"),
        ("walk.mcap", MAP.replace("[base]", "[bass]"), "no field bass"),
        ("walk.mcap", "names = [", "map.toml"),
        ("walk.mcap", MAP.replace('"/base"', '"/joint_states"'), "cannot both"),
        ("walk.mcap", "min_episode_s = 100\n" + MAP, "has no 100"),
        ("noise.mcap", MAP, "cannot be read as a ROS 2 bag"),
        ("none.mcap", MAP, "is missing"),
    ):
        (tmp_path / "map.toml").write_text(text)
        command = ["data", "import", "ros2", str(tmp_path / bag)]
        into = ["--map", str(tmp_path / "map.toml"), "--dataset", str(tmp_path / "new")]
        assert main([*command, *into]) == 2, text
        error = capsys.readouterr().err
        assert message in error
        assert len(error.splitlines()) == 1
