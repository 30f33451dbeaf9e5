"""Bonuses for new motion and the KL penalty: arithmetic, resume, and what they do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import pytest
import torch
from torch import Tensor

from benchmarks.exploration import coverage, settled_kl
from data.features import FEATURE_DIM, column
from policy.env.env_cfg import EnvCfg
from policy.extensions.bonus import (
    MOTION_SCALE,
    EntropyBonus,
    ExplorationBonusCfg,
    base_motion,
)
from policy.extensions.kl_penalty import KlPenalty, KlPenaltyCfg
from policy.robots.robot import Robot, load_robot
from policy.training.ppo import PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg

ENV = EnvCfg(episode_s=0.4)
PPO = PpoCfg(num_envs=4, hidden_sizes=(8,), init_std=0.1)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot(physics_dt_s=ENV.physics_dt_s)


def _rows(forward_m_s: Tensor) -> Tensor:
    """Feature rows that differ in forward speed alone."""
    rows = torch.zeros(*forward_m_s.shape, FEATURE_DIM)
    rows[..., column("base_lin_vel_b").start] = forward_m_s
    return rows


def test_motion_is_that_of_the_base_and_scaled() -> None:
    """One scale of forward speed is 1; joints do not count."""
    rows = _rows(torch.tensor([MOTION_SCALE[0], 1e9]))
    rows[:, column("joint_vel")] = 7.0
    assert base_motion(rows)[:, 0].tolist() == pytest.approx([1.0, 20.0])
    assert base_motion(rows)[:, 1:].eq(0.0).all()


def test_entropy_is_the_distance_to_the_kth_nearest_state() -> None:
    """Of memories at 0, 1, 3 scales, the second nearest to a state at 1 is 1 away."""
    cfg = ExplorationBonusCfg(kind="entropy", neighbors=2, memory=3)
    bonus = EntropyBonus(cfg, step_dt_s=0.02)
    bonus.memory[:, 0] = torch.tensor([0.0, 1.0, 3.0])
    bonus.iterations += 1
    state = torch.zeros(1, 1, 6)
    state[..., 0] = 1.0
    assert float(bonus.novelty(state)) == pytest.approx(torch.log(torch.tensor(2.0)))


@pytest.mark.parametrize("kind", ["rnd", "entropy"])
def test_what_is_rare_pays_and_the_rollout_sums_to_nothing(
    kind: Literal["rnd", "entropy"],
) -> None:
    """After many rollouts at rest the one robot that moves has the largest bonus."""
    torch.manual_seed(0)
    cfg = ExplorationBonusCfg(kind=kind, weight=3.0, memory=64)
    bonus = cfg.make(step_dt_s=0.02)
    speeds = 0.02 * torch.randn(8, 16)
    for _ in range(40):
        bonus(_rows(speeds))
    speeds[3, 5] = 1.5
    paid = bonus(_rows(speeds))
    assert paid.flatten().argmax() == 3 * 16 + 5
    assert float(paid.sum()) == pytest.approx(0.0, abs=1e-4)
    assert float(paid.std()) == pytest.approx(3.0 * 0.02, rel=1e-3)


def test_the_bonus_fades() -> None:
    """A quarter of the way its weight is three quarters, and 0 at the end."""
    cfg = ExplorationBonusCfg(kind="entropy", decay_iterations=4, memory=64)
    bonus = EntropyBonus(cfg, step_dt_s=0.02)
    weights, paid = [], []
    for _ in range(6):
        weights.append(bonus.weight)
        paid.append(bonus(_rows(torch.rand(8, 16))))
    assert weights == [1.0, 0.75, 0.5, 0.25, 0.0, 0.0]
    assert paid[0].ne(0.0).any()
    assert paid[-1].eq(0.0).all()


@pytest.mark.parametrize(
    "options",
    [
        {"bonus": ExplorationBonusCfg(kind="rnd", decay_iterations=4)},
        {"bonus": ExplorationBonusCfg(kind="entropy", memory=64, decay_iterations=4)},
        {"kl_penalty": KlPenaltyCfg(kind="adaptive")},
    ],
    ids=["rnd", "entropy", "kl"],
)
def test_a_resumed_run_ends_as_an_undisturbed_one(
    options: dict, robot: Robot, tmp_path: Path
) -> None:
    """Predictor, memory, schedule and beta are where they were."""
    ppo = replace(PPO, **options)

    def until(iterations: int) -> TrainCfg:
        steps = iterations * ppo.steps_per_iteration
        return TrainCfg(steps=steps, env=ENV, ppo=ppo)

    train(tmp_path / "whole", robot, until(4))
    train(tmp_path / "cut", robot, until(2))
    train(tmp_path / "cut", robot, until(4), resume=True)
    whole = (tmp_path / "whole/policy.pt").read_bytes()
    assert (tmp_path / "cut/policy.pt").read_bytes() == whole


def test_beta_doubles_and_halves() -> None:
    """As the paper says: at d < target / 1.5 and d > 1.5 target, and not between."""
    penalty = KlPenalty(KlPenaltyCfg(kind="adaptive", beta=1.0, target=0.01))
    for kl, beta in ((0.016, 2.0), (0.0149, 2.0), (0.0067, 2.0), (0.0066, 1.0)):
        penalty._kls = [9.0, kl, kl]
        assert penalty.adapt(2) == pytest.approx(kl)
        assert penalty.beta == beta


@pytest.mark.slow
def test_the_kl_settles_where_it_is_asked_to() -> None:
    """Adapted, it comes to lie around the target; with a weight of next to nothing,
    it does not."""
    target = KlPenaltyCfg(kind="adaptive", beta=0.01)
    kl = settled_kl(target, iterations=24, num_envs=32)
    assert target.target / 1.5 <= kl <= target.target * 1.5
    free = KlPenaltyCfg(kind="fixed", beta=1e-3)
    assert settled_kl(free, iterations=12, num_envs=32) > 2 * target.target


@pytest.mark.slow
def test_a_bonus_shows_more_motion() -> None:
    """A small version of `benchmarks.exploration`."""
    size = {"seed": 0, "iterations": 24, "num_envs": 48}
    entropy = ExplorationBonusCfg(kind="entropy")
    assert coverage(entropy, **size) > 1.25 * coverage(None, **size)
