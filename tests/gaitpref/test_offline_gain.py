"""Learning from data alone is tried, and what it was worth is said."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from torch import Tensor

from data.datasets.dataset import Dataset
from data.features import column
from gaitpref.cli.main import main
from gaitpref.cli.options import options
from gaitpref.cli.shared.off_policy import told_offline
from gaitpref.training.offline_gain import offline_gain
from policy.env.env_cfg import EnvCfg
from policy.offpolicy.off_policy_runner import OffPolicy
from policy.robots.robot import load_robot
from policy.robots.shipped import WALK
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg
from policy.training.checkpoint import Policy, holding_home, load_policy, read_plain
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


def _started(out: Path, init: Path, engine: OffPolicy | None = None) -> Path:
    """`init` as a policy whose episodes take a second."""
    policy = load_policy(init)
    env = replace(policy.info.env, episode_s=1.0)
    cfg = TrainCfg(steps=0, env=env, ppo=PpoCfg(num_envs=4))
    return train(out, policy.robot(), cfg, init=init, engine=engine).policy


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The walk that ships, for short episodes."""
    return _started(tmp_path_factory.mktemp("walk"), WALK)


@pytest.fixture(scope="module")
def standing(tmp_path_factory: pytest.TempPathFactory, walk: Path) -> Path:
    """One that stands, of the off-policy learner."""
    root = tmp_path_factory.mktemp("standing")
    file = root / "standing.pt"
    file.write_bytes(holding_home(_started(root / "fast", walk, OffPolicy())))
    return file


def _recorded(root: Path, policy: Path) -> Path:
    cfg = RecordCfg(episodes=4, episode_s=1.0, checkpoints=0)
    Dataset.create(root).add_episodes(record(policy, cfg, seed=0))
    return root


def _offline(tmp_path: Path, *more: str | Path) -> int:
    words = ["train", "--out", tmp_path / "out", "--algorithm", "fastsac", "--offline"]
    words += ["--steps", "512", "--envs", "4", *more]
    return main(list(map(str, words)))


def test_the_command_says_it(
    tmp_path: Path, walk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Beside the policy it began from; last that nothing was gained, and the exit code
    is neither that of a success nor of a mistake. The policy is kept. Finished, it is
    tried again by who goes on with it."""
    replay = _recorded(tmp_path / "set", walk)
    reward = ("--reward", "high_step", "--keep-task", "--clone-weight", "0.2")
    init = ("--init", walk, "--replay", replay, "--updates-per-step", "0.05")
    assert _offline(tmp_path, *reward, *init) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "tried, it earns" in said
    _, last = said.split("the data alone gained nothing")
    assert last.endswith("so that it tries what it learns")
    assert _offline(tmp_path, *reward, *init, "--resume") == 1
    assert " ".join(capsys.readouterr().err.split()).endswith(last)
    assert (tmp_path / "out" / "policy.pt").exists()
    was = json.loads(read_plain(tmp_path / "out" / "resume.pt")["identity"])
    assert was["algorithm"]["sac"]["clone_weight"] == 0.2
    given = ["train", "--out", str(tmp_path / "online"), "--algorithm", "fastsac"]
    assert main([*given, "--reward", "task", "--clone-weight", "0.2"]) == 2
    assert "--clone-weight is about --offline" in capsys.readouterr().err


def moving(features: Tensor) -> Tensor:
    """Pays for actions, 0 for none."""
    asked = features[..., column("action")].square().mean(dim=-1)
    return asked / (0.1 + asked)


def test_what_gained_ends_well(
    tmp_path: Path,
    walk: Path,
    standing: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """One that stood learned to move, from the walk's episodes alone. What it is told
    to earn is what is paid, in a second at most 1."""
    replay = _recorded(tmp_path / "set", walk)
    reward = ("--reward", f"{__name__}:moving", "--replay", replay)
    assert _offline(tmp_path, *reward, "--init", standing) == 0
    said = " ".join(capsys.readouterr().err.split())
    (earned,) = re.findall(r"tried, it earns (\S+) ±", said)
    assert float(earned) > 0.1
    assert "gained nothing" not in said


def test_what_left_the_data_behind_is_refused(
    tmp_path: Path,
    walk: Path,
    standing: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A walk, too new to its critics to change yet, is nowhere near who stands."""
    replay = _recorded(tmp_path / "set", standing)
    words = ("--reward", "task", "--init", walk, "--replay", replay)
    assert _offline(tmp_path, *words, "--updates-per-step", "0.05") == 2
    said = " ".join(capsys.readouterr().err.split())
    _, last = said.split("the data do not hold what the reward wants")
    assert last.endswith("or leave --offline out")


def test_without_a_policy_it_is_compared_with_the_data(
    tmp_path: Path, walk: Path, untrained: Policy
) -> None:
    """What is learned of a walk in a moment earns less than the walk did."""
    robot, env = untrained.robot(), replace(untrained.info.env, episode_s=1.0)
    replay, lines = _recorded(tmp_path / "set", walk), list[str]()
    engine = OffPolicy(replay=(replay,), offline=True)
    cfg = TrainCfg(steps=96, env=env, ppo=PpoCfg(num_envs=4))
    result = train(tmp_path / "out", robot, cfg, engine=engine)
    command = options.Train(out=tmp_path / "out", reward="task")
    assert told_offline(command, result, robot, env, None, lines.append) != 0
    (told,) = (line for line in lines if line.startswith("tried, it earns"))
    assert re.search(r"who made the data \d\S+ in as many steps: the data alone", told)
    walked = offline_gain(0.0, load_policy(walk), robot, env, None)
    data = walked.after.return_mean
    lost = offline_gain(data, untrained, robot, env, None)
    assert walked.gained
    assert not lost.gained
    assert f"who made the data {data:.2f} in as many steps" in lost.words
    assert "begin from a policy, with --init" in lost.words
