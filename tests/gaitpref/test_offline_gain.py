"""Learning from data alone is tried, and what it was worth is said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from data.datasets.dataset import Dataset
from gaitpref.cli.main import main
from gaitpref.training.offline_gain import offline_gain
from policy.env.env_cfg import EnvCfg
from policy.robots.robot import load_robot
from policy.robots.shipped import WALK
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg
from policy.training.checkpoint import Policy, load_policy
from policy.training.ppo import PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg


@pytest.fixture(scope="module")
def untrained(tmp_path_factory: pytest.TempPathFactory) -> Policy:
    """A policy that has learned nothing."""
    out = tmp_path_factory.mktemp("untrained")
    env = EnvCfg()
    cfg = TrainCfg(steps=96, env=env, ppo=PpoCfg(num_envs=4, hidden_sizes=(8,)))
    robot = load_robot(physics_dt_s=env.physics_dt_s)
    return load_policy(train(out, robot, cfg).policy)


def test_a_walk_is_a_gain_and_to_forget_it_is_none(untrained: Policy) -> None:
    walk = load_policy(WALK)
    robot, env = walk.robot(), replace(walk.info.env, episode_s=2.0)
    found = offline_gain(untrained, walk, robot, env, None)
    assert found.gained
    assert "gained nothing" not in found.words
    assert not offline_gain(walk, walk, robot, env, None).gained
    lost = offline_gain(walk, untrained, robot, env, None)
    assert not lost.gained
    assert "the data alone gained nothing" in lost.words


def test_the_command_says_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Beside the policy it began from."""
    dataset = Dataset.create(tmp_path / "set")
    cfg = RecordCfg(episodes=2, episode_s=1.0, checkpoints=0)
    dataset.add_episodes(record(WALK, cfg, seed=0))
    words = ["train", "--out", str(tmp_path / "out"), "--reward", "high_step"]
    words += ["--keep-task", "--algorithm", "fastsac", "--offline", "--init", str(WALK)]
    words += ["--replay", str(tmp_path / "set"), "--steps", "512", "--envs", "4"]
    assert main(words) == 0
    assert "tried, it earns" in capsys.readouterr().err
