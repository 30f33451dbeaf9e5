"""Generators of one run never draw the same numbers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import EnvCfg, getup_env
from policy.env.seeding import spawned
from policy.robots.robot import load_robot
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg
from policy.rollouts.variation import VariationCfg
from policy.training.ppo import PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg

PPO = PpoCfg(num_envs=4, hidden_sizes=(8,))
CFG = TrainCfg(steps=PPO.steps_per_iteration, env=EnvCfg(episode_s=0.4), ppo=PPO)


@pytest.fixture
def seeds(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The seeds of all generators that are made."""
    found: list[int] = []

    class Noted(torch.Generator):
        def manual_seed(self, seed: int) -> torch.Generator:
            found.append(seed)
            return super().manual_seed(seed)

    monkeypatch.setattr(torch, "Generator", Noted)
    return found


def test_environment_and_actor_draw_other_numbers_in_a_recording(
    tmp_path: Path, seeds: list[int]
) -> None:
    """Start states are one thing, postures and exploration noise another: with equal
    seeds, the robots that start crooked would be those that vary."""
    robot = load_robot(physics_dt_s=CFG.env.physics_dt_s)
    policy_file = train(tmp_path, robot, CFG).policy
    seeds.clear()
    cfg = RecordCfg(episodes=4, episode_s=0.2, variation=VariationCfg(share=0.5))
    for seed in (0, 1):
        list(record(policy_file, replace(cfg, checkpoints=0), seed=seed))
    assert len(seeds) == 4
    assert len(set(seeds)) == 4


def test_environment_and_updates_draw_other_numbers_in_a_training(
    tmp_path: Path, seeds: list[int]
) -> None:
    """Also with robots that are dropped before, as those that lie are."""
    robot = load_robot(physics_dt_s=CFG.env.physics_dt_s)
    updates: list[int] = []

    def noted(stats: Any) -> None:
        updates.append(torch.initial_seed())

    cfg = replace(CFG, env=replace(getup_env(CFG.env), episode_s=0.4))
    train(tmp_path, robot, cfg, on_iteration=noted)
    assert len(seeds) == 2
    assert len({*seeds, *updates, cfg.seed}) == 4


def test_a_reset_with_a_seed_draws_what_a_new_environment_draws() -> None:
    robot = load_robot(physics_dt_s=CFG.env.physics_dt_s)
    one, other = (QuadrupedEnv(robot, CFG.env, 4, seed=seed) for seed in (3, 4))
    fresh = one.get_observations()["policy"].clone()
    assert not torch.equal(other.get_observations()["policy"], fresh)
    assert torch.equal(other.reset(seed=3)["policy"], fresh)


def test_spawned_seeds_are_the_same_every_time_and_all_differ() -> None:
    assert spawned(0, 3) == spawned(0, 3)
    assert spawned(0, 3)[:2] == spawned(0, 2)
    every = [seed for number in range(200) for seed in spawned(number, 3)]
    assert len(set(every)) == len(every)
