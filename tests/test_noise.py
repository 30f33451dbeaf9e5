"""Noise comes down where the rate of steps is paid for, and nowhere else."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from gaitpref.loop_cfg import ExplorationCfg, LoopCfg
from gaitpref.noise import pays_for_rate, with_noise
from gaitpref.setting import setting_of
from policy.checkpoint import Policy, load_policy
from policy.config import EnvCfg
from policy.ppo import PpoCfg
from policy.train import TrainCfg, train
from rewardmodel import FitCfg, RewardModel, fit_reward

from .small_loop import small_cfg
from .test_rewardmodel_sparse import Taste, asked, best_height, best_rate

PPO = PpoCfg(num_envs=32, hidden_sizes=(16,))
PLAIN = TrainCfg(steps=100, env=EnvCfg(), ppo=PPO)


@pytest.fixture
def style() -> LoopCfg:
    return replace(small_cfg(base="task"), rounds=3, exploration=None, calm_std=0.1)


@pytest.fixture(scope="module")
def paying() -> Callable[[Taste], RewardModel]:
    def fitted(taste: Taste) -> RewardModel:
        cfg = FitCfg(kind="sparse")
        model, _ = fit_reward(asked(taste, 120, seed=0), cfg, seed=0, measured=False)
        return model

    return fitted


@pytest.fixture(scope="module")
def policy_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[float], Policy]:
    """An untrained policy with noise of some size."""
    setting = setting_of(None, None)

    def untrained(std: float) -> Policy:
        out = tmp_path_factory.mktemp("policy")
        cfg = TrainCfg(steps=0, env=setting.env, ppo=PPO, exploration_std=std)
        train(out, setting.robot, cfg)
        return load_policy(out / "policy.pt")

    return untrained


def test_it_comes_down_where_the_rate_of_steps_is_paid_for(
    style: LoopCfg,
    paying: Callable[[Taste], RewardModel],
    policy_of: Callable[[float], Policy],
) -> None:
    rate, height, start = paying(best_rate), paying(best_height), policy_of(0.5)
    assert pays_for_rate(rate)
    assert not pays_for_rate(height)
    calm = with_noise(style, 1, PLAIN, rate, start)
    assert calm.final_std == style.calm_std
    assert calm.calm_from == style.calm_from
    assert calm.exploration_std is None
    assert with_noise(style, 1, PLAIN, height, start) == PLAIN
    assert with_noise(replace(style, calm_std=None), 1, PLAIN, rate, start) == PLAIN


def test_what_came_down_is_put_back_whatever_is_paid_for(
    style: LoopCfg,
    paying: Callable[[Taste], RewardModel],
    policy_of: Callable[[float], Policy],
) -> None:
    """A policy whose noise is gone learns nothing new, even of another wish; but what
    was learned with little of it is lost under as much as at first."""
    for taste in (best_rate, best_height):
        model, calm = paying(taste), policy_of(0.1)
        stds = [
            with_noise(style, round, PLAIN, model, calm).exploration_std
            for round in (1, 2, 3)
        ]
        assert stds == [style.noise_back, style.noise_again, style.noise_again]
        assert style.noise_again < style.noise_back


def test_from_scratch_it_is_put_back_every_round(
    style: LoopCfg,
    paying: Callable[[Taste], RewardModel],
    policy_of: Callable[[float], Policy],
) -> None:
    """And comes down in the last one alone, whatever is paid for."""
    cfg = replace(style, exploration=ExplorationCfg(), calm_std=None)
    model, start = paying(best_rate), policy_of(0.5)
    stds = [with_noise(cfg, n, PLAIN, model, start) for n in (1, 2, 3)]
    assert all(each.exploration_std is not None for each in stds)
    assert [each.final_std is None for each in stds] == [True, True, False]
