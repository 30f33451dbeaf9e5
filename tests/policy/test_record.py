"""Recording and evaluation of policies on the real simulator."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from data.datasets.dataset import Dataset
from data.episodes.clips import cut_clips
from data.episodes.episode import Episode
from data.features import FEATURE_DIM, column
from policy.env.env_cfg import EnvCfg
from policy.robots.robot import Robot, load_robot
from policy.rollouts.evaluate import command_grid, rollout_features, summarise
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg, recorded_commands
from policy.rollouts.rollout import hold_home
from policy.sim.batch_sim import BatchSim
from policy.training.checkpoint import Policy, load_policy
from policy.training.ppo import PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg

ENV = EnvCfg()
RECORD = RecordCfg(episodes=20, episode_s=1.0)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot(physics_dt_s=ENV.physics_dt_s)


@pytest.fixture(scope="module")
def policy_file(robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A policy of five iterations with its checkpoints beside it."""
    ppo = PpoCfg(num_envs=8, hidden_sizes=(8,))
    cfg = TrainCfg(steps=5 * ppo.steps_per_iteration, env=ENV, ppo=ppo)
    return train(tmp_path_factory.mktemp("policy"), robot, cfg).policy


def _ones(features: Tensor, starts: Tensor) -> Tensor:
    return torch.ones(starts.shape)


def test_an_episode_holds_what_happened(policy_file: Path) -> None:
    """States lead into one another, and the rows are those of the states."""
    episodes = list(record(policy_file, RECORD, seed=0))
    assert len(episodes) == 20
    for episode in episodes:
        height = episode.features[:, column("base_height")][:, 0]
        assert height == pytest.approx(episode.qpos[1:, 2], abs=1e-5)
        command = episode.features[:, column("command")]
        assert command == pytest.approx(
            np.tile(episode.meta.command, (len(command), 1))
        )
        clipped = np.clip(episode.action, -ENV.action_limit, ENV.action_limit)
        assert episode.features[:, column("action")] == pytest.approx(clipped)
        assert np.abs(episode.action).max() <= ENV.action_limit
        assert np.abs(episode.obs[1:, 0:3] - episode.features[:, 0:3]).max() < 1e-5
        fallen = episode.features[:, column("fallen")][:, 0]
        assert not fallen[:-1].any()
        assert bool(fallen[-1]) == (episode.end_reason == "terminated")
        assert episode.end_reason == "terminated" or episode.num_steps == 50


def test_on_one_thread_the_episodes_are_the_same(policy_file: Path) -> None:
    """To the last bit, so that a training beside it decides nothing."""
    cfg = RecordCfg(episodes=6, episode_s=0.2, checkpoints=0)
    one, all_of_them = (
        list(record(policy_file, cfg, seed=0, threads=threads)) for threads in (1, 0)
    )
    for left, right in zip(one, all_of_them, strict=True):
        assert np.array_equal(left.qpos, right.qpos)
        assert np.array_equal(left.features, right.features)


def test_checkpoints_commands_and_noise_are_mixed(policy_file: Path) -> None:
    """Clips of one command come from several policies, with and without noise."""
    episodes = list(record(policy_file, RECORD, seed=0))
    policies = {episode.meta.policy_sha256 for episode in episodes}
    assert len(policies) == 1 + RECORD.checkpoints
    newest = load_policy(policy_file).sha256
    assert sum(e.meta.policy_sha256 == newest for e in episodes) == 11
    assert {e.meta.command for e in episodes} == set(recorded_commands(ENV.commands))
    assert {e.meta.stochastic for e in episodes} == {True, False}


def test_equal_seeds_record_equal_episodes(policy_file: Path, tmp_path: Path) -> None:
    """The files are the same, and recording them again adds nothing."""
    dataset = Dataset.create(tmp_path)
    first = dataset.add_episodes(record(policy_file, RECORD, seed=3))
    again = dataset.add_episodes(record(policy_file, RECORD, seed=3))
    other = dataset.add_episodes(record(policy_file, RECORD, seed=4))
    assert [e.sha256 for e in first] == [e.sha256 for e in again]
    assert not {e.sha256 for e in first} & {e.sha256 for e in other}


def test_a_diverged_simulation_reaches_no_clip(
    policy_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One NaN: its episode is aborted, and no clip is cut out of it."""
    advance, calls = BatchSim.advance, 0

    def poisoned(sim: BatchSim, substeps: int) -> Tensor:
        nonlocal calls
        calls += 1
        if calls == 30:
            sim._qpos[3, 7] = np.nan
        return advance(sim, substeps)

    monkeypatch.setattr(BatchSim, "advance", poisoned)
    cfg = RecordCfg(episodes=20, episode_s=1.0, checkpoints=0, noisy_share=0.0)
    dataset = Dataset.create(tmp_path)
    dataset.add_episodes(record(policy_file, cfg, seed=0))
    entries = dataset.entries()
    (aborted,) = [e for e in entries if e.end_reason == "aborted"]
    assert aborted.meta.env_index == 3
    assert aborted.num_steps == 30
    clips = cut_clips(entries, steps=20, stride=10, min_steps=10)
    assert clips
    assert aborted.sha256 not in {clip.rollout for clip in clips}
    assert all(np.isfinite(dataset.clip_features(clip)).all() for clip in clips)


def test_holding_the_home_pose_stands(robot: Robot) -> None:
    """No fall, full length, and as wrong as the commands are fast."""
    rolled_out = rollout_features(hold_home, robot, ENV, episodes=16, seed=0)
    result = summarise(*rolled_out, _ones, control_dt_s=ENV.control_dt_s)
    assert result.falls == 0
    assert result.episode_length_s == pytest.approx(10.0)
    assert result.return_mean == pytest.approx(10.0)
    assert result.return_ci95 == pytest.approx(0.0)
    mean_speed = float(command_grid(ENV, 16)[:, 0].mean())
    assert result.tracking_error_m_s == pytest.approx(mean_speed, abs=0.03)


def test_an_evaluation_by_hand() -> None:
    """Two episodes of 2 and 3 steps, the second falls; a third one was aborted."""
    features = torch.zeros(3, 3, FEATURE_DIM)
    features[..., column("command")] = torch.tensor([0.5, 0.0, 0.0])
    features[2, 1, column("fallen")] = 1.0
    features[:, 0, column("joint_torque")] = 2.0
    features[:, 0, column("joint_vel")] = -1.0

    def score(features: Tensor, starts: Tensor) -> Tensor:
        assert starts.tolist() == [[True, True], [False, False], [False, False]]
        return torch.tensor([[1.0, 2.0], [1.0, 2.0], [100.0, 2.0]])

    result = summarise(features, torch.tensor([2, 3, 0]), score, control_dt_s=0.02)
    assert result.episodes == 2
    assert result.aborted == 1
    assert result.return_mean == pytest.approx((2 * 0.02 + 6 * 0.02) / 2)
    # Returns 0.04 and 0.12: deviation 0.0566, over the root of two.
    assert result.return_ci95 == pytest.approx(1.96 * 0.04)
    assert result.score_mean == pytest.approx(8 / 5)
    assert result.tracking_error_m_s == pytest.approx(0.5)
    assert result.falls_per_minute == pytest.approx(1 / (5 * 0.02 / 60))
    assert result.power_w == pytest.approx(2 * 24 / 5)


def test_policies_may_be_handed_in(policy_file: Path) -> None:
    """A policy that is not on disk can be recorded as well."""
    policy: Policy = load_policy(policy_file)
    episodes: list[Episode] = list(
        record(Path("nowhere"), RECORD, seed=0, policies=[policy])
    )
    assert {e.meta.policy_sha256 for e in episodes} == {policy.sha256}


def test_a_manoeuvre_asks_for_one_command_after_the_other(policy_file: Path) -> None:
    """Every 0.2 s the next of the recorded commands, in rows and observations."""
    manoeuvre = RecordCfg(episodes=10, episode_s=0.5, change_s=0.2)
    choices = recorded_commands(ENV.commands)
    for episode in record(policy_file, manoeuvre, seed=0):
        first = choices.index(episode.meta.command)
        asked = [choices[(first + turn) % len(choices)] for turn in (0, 1, 2)]
        expected = np.repeat(asked, 10, axis=0)[: episode.num_steps]
        assert episode.features[:, column("command")] == pytest.approx(expected)
        assert episode.obs[: episode.num_steps, 45:] == pytest.approx(expected)
        assert episode.meta.command_change_steps == 10


def test_lengths_that_cannot_be_are_refused() -> None:
    with pytest.raises(ValueError, match=r"change_s must be positive, got 0.0"):
        RecordCfg(change_s=0.0)
    with pytest.raises(ValueError, match=r"episode_s must be positive, got -1.0"):
        RecordCfg(episode_s=-1.0)
