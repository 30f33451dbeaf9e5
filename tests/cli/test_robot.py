"""`gaitpref robot inspect` on a robot that somebody else drew."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from matplotlib.image import imread

from data.datasets.dataset import Dataset
from gaitpref.cli.commands.looking.play import live_policy
from gaitpref.cli.main import main
from labeling_ui.scene.geometry import instance_poses, robot_geometry
from labeling_ui.scene.live_robot import Drive
from policy.env.env_cfg import EnvCfg
from policy.env.task_reward import TaskRewardCfg, size_of, task_reward_for
from policy.robots.robot import load_robot, load_robot_xml
from tests.helpers.foreign_robots import Drawing, mjcf, urdf


def test_inspect_prints_what_was_found_and_draws_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Legs, servos, feet and changes in words; a picture with a robot in it."""
    xml = tmp_path / "stranger.xml"
    xml.write_text(mjcf(Drawing(floor="")))
    assert main(["robot", "inspect", str(xml), "--out", str(tmp_path / "out")]) == 0
    text = capsys.readouterr().out
    assert "stranger, 15.0 kg, of which 'torso' weighs 8.0 kg" in text
    order = [text.index(f"{leg}_j0") for leg in ("fr", "fl", "rr", "rl")]
    assert order == sorted(order)
    assert "changed    the model has no ground: a floor at z = 0 was added" in text
    assert "changed    home was searched" in text
    picture = imread(tmp_path / "out" / "stranger.png")
    assert picture.shape[0] > 400
    assert (np.ptp(picture[..., :3], axis=-1) < 0.05).mean() > 0.5
    # The left view is full of the robot's grey, not of the white of the paper.
    grey = (picture[..., :3] < 0.8).all(axis=-1)
    assert 0.02 < grey.mean() < 0.5
    completed = (tmp_path / "out" / "stranger.xml").read_text()
    assert mujoco.MjModel.from_xml_string(completed).nu == 12


def test_what_has_to_be_written_is_shown_below_the_message(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    xml = tmp_path / "stranger.xml"
    xml.write_text(mjcf(Drawing(foot="")))
    assert main(["robot", "inspect", str(xml)]) == 2
    first, *lines = capsys.readouterr().err.splitlines()
    assert first.startswith(f"gaitpref: {xml}: body 'fr_shank' at the end of a leg has")
    assert lines[0] == "[feet]"
    assert lines[1:] == [f'{leg} = "{leg}_foot"' for leg in ("FR", "FL", "RR", "RL")]


def test_the_task_is_measured_by_the_size_of_the_robot() -> None:
    """The robot that ships keeps its weights to the bit; a larger one may push more."""
    dt_s = EnvCfg().physics_dt_s
    go1 = load_robot(physics_dt_s=dt_s)
    assert size_of(go1) == (1.0, 1.0)
    cfg = task_reward_for(go1, TaskRewardCfg())
    assert cfg == TaskRewardCfg(height_m=0.95 * go1.home_qpos[2])
    other = load_robot_xml(mjcf(Drawing()), name="other", physics_dt_s=dt_s)
    taller = other.home_qpos[2] / go1.home_qpos[2]
    heavier = 15.0 / 12.744
    theirs = task_reward_for(other, TaskRewardCfg())
    assert theirs.torque == pytest.approx(-2e-4 / (taller * heavier) ** 2, rel=0.01)
    assert theirs.clearance_m == pytest.approx(0.08 * taller, rel=0.01)


def test_a_stranger_is_trained_recorded_drawn_and_driven(tmp_path: Path) -> None:
    """From its MJCF to a policy, episodes, the page's geometry, and play."""
    xml = tmp_path / "stranger.xml"
    xml.write_text(mjcf(Drawing(sign=-1.0, order=("rr", "fr", "rl", "fl"))))
    out, folder = tmp_path / "run", tmp_path / "dataset"
    train = ["train", "--out", str(out), "--reward", "task", "--robot", str(xml)]
    assert main([*train, "--envs", "8", "--steps", "192"]) == 0
    policy = out / "policy.pt"
    record = ["record", "--policy", str(policy), "--dataset", str(folder)]
    assert main([*record, "--episodes", "2"]) == 0
    dataset = Dataset.open(folder)
    episode = dataset.read(dataset.entries()[0].sha256)
    geometry = robot_geometry(episode.mjcf)
    positions, _ = instance_poses(geometry, episode.qpos[:2])
    assert len(geometry.instance_body_ids) >= 9
    assert np.isfinite(positions).all()
    step = live_policy(policy, None).new_step()
    drive = Drive(command=(0.3, 0.0, 0.0))
    assert np.isfinite(step(drive).qpos).all()
    assert np.isfinite(live_policy(policy, xml).new_step()(drive).qpos).all()


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ("", "a floating joint was added above the base 'trunk', which a URDF fixes"),
        (
            '<link name="world"/><joint name="mount" type="fixed">'
            '<parent link="world"/><child link="trunk"/></joint>',
            "the fixed joint 'mount', which held 'trunk' to the world, floats",
        ),
    ],
)
def test_a_urdf_whose_base_is_fixed_is_freed_and_that_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: str, told: str
) -> None:
    """As nearly all that are published; it is the robot of the file."""
    path = tmp_path / "dog.urdf"
    path.write_text(urdf(more))
    assert main(["robot", "inspect", str(path), "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert f"changed    {told}" in out
    assert "stranger, 12.2 kg, of which 'trunk' weighs 6.0 kg" in out
    assert (tmp_path / "stranger.png").exists()
