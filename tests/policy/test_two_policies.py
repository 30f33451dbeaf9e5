"""A team whose robots have a policy each, in one file."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from tensordict import TensorDict

from data.datasets.dataset import Dataset
from data.episodes.team_rows import SIGHT_DIM
from gaitpref.cli.main import main
from policy.env.feature_row import OBS_DIM
from policy.env.team_cfg import TeamCfg
from policy.robots.shipped import WALK
from policy.team.team_env import TwoPpo, team_runner
from policy.team.team_start import as_team
from policy.training.checkpoint import PolicyError, load_policy, read_plain, saved_bytes
from policy.training.ppo import PpoCfg, Runner
from policy.training.session import TrainResult
from policy.training.train import train
from policy.training.train_cfg import TrainCfg


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The walk that ships, once for each robot."""
    file = tmp_path_factory.mktemp("two") / "both.pt"
    file.write_bytes(as_team(WALK, TeamCfg(), policies=2))
    return file


def cfg_of(start: Path, steps: int) -> TrainCfg:
    info = load_policy(start).info
    ppo = PpoCfg(
        num_envs=4, hidden_sizes=info.ppo.hidden_sizes, policies=info.ppo.policies
    )
    return TrainCfg(steps=steps, env=info.env, ppo=ppo, checkpoints=0)


def trained(start: Path, out: Path, steps: int, *, resume: bool = False) -> TrainResult:
    return train(
        out,
        load_policy(start).robot(),
        cfg_of(start, steps),
        init=start,
        resume=resume,
        engine=team_runner,
    )


def seen(count: int) -> torch.Tensor:
    """What `count` first and as many second robots see, the same for both."""
    rng = torch.Generator().manual_seed(0)
    own = torch.randn(count, OBS_DIM + SIGHT_DIM, generator=rng)
    parts = [torch.cat([own, torch.full((count, 1), whose)], 1) for whose in (0.0, 1.0)]
    return torch.cat(parts)


def test_both_begin_as_what_they_shared(both: Path, tmp_path: Path) -> None:
    """From a walk alone, and from a team that shares one."""
    shared = tmp_path / "shared.pt"
    shared.write_bytes(as_team(WALK, TeamCfg()))
    again = tmp_path / "again.pt"
    again.write_bytes(as_team(shared, TeamCfg(), policies=2))
    obs = seen(5)
    once = load_policy(shared)(obs[:, :-1])
    for file in (both, again):
        policy = load_policy(file)
        torch.testing.assert_close(policy(obs), once)
        noise = torch.ones(10, 12)
        shaken = policy(obs, noise) - policy(obs)
        torch.testing.assert_close(shaken[:5], policy.std[0].expand(5, 12))
    with pytest.raises(PolicyError, match="of a team already"):
        as_team(both, TeamCfg(), policies=2)


def test_each_learns_from_its_own_rows_and_pay(both: Path) -> None:
    policy = load_policy(both)
    runner = team_runner(policy.robot(), cfg_of(both, 96), 0)
    assert isinstance(runner, Runner)
    assert isinstance(runner.alg, TwoPpo)
    rows = seen(5)
    runner.alg.actor(TensorDict({"policy": rows}, batch_size=[10]), None, None, True)
    runner.alg.actor.get_output_log_prob(torch.zeros(10, 12))[:5].sum().backward()
    moved = {
        name.split(".")[1]: float(weight.grad.abs().sum())
        for name, weight in runner.alg.actor.named_parameters()
        if name.endswith("mlp.0.weight") and weight.grad is not None
    }
    assert moved["0"] > 0.0
    assert moved["1"] == 0.0
    # Paid by very different measures, advantages of each are about its own.
    with torch.inference_mode():
        obs, _ = runner.collect(runner.env.get_observations())
        runner.alg.storage.rewards[:, 1::2] *= 100.0
        runner.alg.compute_returns(obs)
    for robot in (0, 1):
        own = runner.alg.storage.advantages[:, robot::2]
        assert float(own.mean()) == pytest.approx(0.0, abs=1e-4)
        assert float(own.std()) == pytest.approx(1.0, abs=1e-3)


def test_a_training_goes_on_bit_for_bit_and_parts_them(
    both: Path, tmp_path: Path
) -> None:
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    trained(both, whole, 192)
    trained(both, cut, 96)
    trained(both, cut, 192, resume=True)
    files = [(each / "policy.pt").read_bytes() for each in (whole, cut)]
    assert files[0] == files[1]
    policy, obs = load_policy(whole / "policy.pt"), seen(5)
    action = policy(obs)
    assert (action[:5] - action[5:]).abs().max() > 1e-4


def test_it_is_recorded_and_what_cannot_be_done_with_it_is_said(
    both: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["team", "record", "--policy", str(both), "--dataset", str(tmp_path / "s")]
    assert main([*given, "--episodes", "2", "--episode-s", "0.5"]) == 0
    dataset = Dataset.open(tmp_path / "s")
    episode = dataset.read(dataset.entries()[0].sha256)
    assert episode.mate is not None
    assert episode.obs.shape[1] == OBS_DIM
    payload = read_plain(both)
    nobody = payload["infos"]["gaitpref"].replace('"told_apart": true', '"gap_m": 0.8')
    blind = tmp_path / "blind.pt"
    blind.write_bytes(saved_bytes({**payload, "infos": {"gaitpref": nobody}}))
    capsys.readouterr()
    out = ["--out", str(tmp_path / "out")]
    for args, words in (
        (["team", "train", "--init", str(both), *out], "give --policies 2"),
        (["export", "--policy", str(both), *out], "walks in a team of two"),
        (["team", "train", "--init", str(blind), *out], "which nothing tells apart"),
        (
            ["options", "--policy", f"a={both}", "--policy", f"b={WALK}", *out],
            "walks in a team of two and sees",
        ),
    ):
        assert main(args) == 2, args
        (line,) = capsys.readouterr().err.splitlines()
        assert words in line
    assert not (tmp_path / "out").exists()
