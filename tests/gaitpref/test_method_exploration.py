"""Noise comes down where the rate of steps is paid for, and nowhere else."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch

from data.features import FEATURE_DIM
from gaitpref.method.context import RoundContext
from gaitpref.method.exploration import Descending, Noise, PutBack, pays_for_rate
from gaitpref.method.method import FROM_SCRATCH, STYLE, Method
from gaitpref.training.by_method import Retraining, with_noise
from policy.env.env_cfg import EnvCfg
from policy.training.checkpoint import Policy, load_policy
from policy.training.ppo import PpoCfg
from policy.training.setup import setting_of
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from rewardmodel import FitCfg, RewardModel, fit_reward
from tests.rewardmodel.test_curves import Taste, asked, best_height, best_rate

PPO = PpoCfg(num_envs=32, hidden_sizes=(16,))
PLAIN = TrainCfg(steps=100, env=EnvCfg(), ppo=PPO)
BACK, DOWN = PutBack(), Descending()


def context(number: int, *, rounds: int = 3) -> RoundContext:
    return RoundContext(number=number, rounds=rounds, labels=60)


@pytest.fixture(scope="module")
def paying() -> Callable[[Taste], RewardModel]:
    def fitted(taste: Taste) -> RewardModel:
        cfg = FitCfg(kind="posterior")
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


def trained(method: Method, number: int, model: RewardModel, start: Policy) -> TrainCfg:
    """`PLAIN` as a retraining makes it; the mirror is left out."""
    return Retraining(
        method=replace(method, mirror=False),
        context=context(number),
        robot=setting_of(None, None).robot,
        model=model,
        seen=torch.zeros(2, 1, FEATURE_DIM),
        start=start,
        base=None,
    ).trained(PLAIN)


def test_it_comes_down_where_the_rate_of_steps_is_paid_for(
    paying: Callable[[Taste], RewardModel], policy_of: Callable[[float], Policy]
) -> None:
    rate, height, start = paying(best_rate), paying(best_height), policy_of(0.5)
    assert pays_for_rate(rate)
    assert not pays_for_rate(height)
    calm = trained(STYLE, 1, rate, start)
    assert calm.final_std == BACK.calm_std
    assert calm.calm_from == BACK.calm_from
    assert calm.exploration_std is None
    assert trained(STYLE, 1, height, start) == PLAIN
    assert trained(replace(STYLE, exploration=None), 1, rate, start) == PLAIN


def test_what_came_down_is_put_back_whatever_is_paid_for(
    paying: Callable[[Taste], RewardModel], policy_of: Callable[[float], Policy]
) -> None:
    """A policy whose noise is gone learns nothing new, even of another wish; but what
    was learned with little of it is lost under as much as at first."""
    for taste in (best_rate, best_height):
        model, calm = paying(taste), policy_of(0.1)
        found = [trained(STYLE, n, model, calm).exploration_std for n in (1, 2, 3)]
        assert found == [BACK.first, BACK.later, BACK.later]
        assert BACK.later < BACK.first


def test_from_scratch_it_is_put_back_every_round(
    paying: Callable[[Taste], RewardModel], policy_of: Callable[[float], Policy]
) -> None:
    """And comes down in the last one alone, whatever is paid for."""
    model, start = paying(best_rate), policy_of(0.5)
    found = [trained(FROM_SCRATCH, n, model, start) for n in (1, 2, 3)]
    assert all(each.exploration_std is not None for each in found)
    assert [each.final_std is None for each in found] == [True, True, False]


@pytest.mark.parametrize(
    ("rounds", "expected"),
    [(1, [0.4]), (2, [0.7, 0.4]), (4, [0.7, 0.7, 0.5, 0.4])],
)
def test_it_descends_from_round_to_round(rounds: int, expected: list[float]) -> None:
    """Whatever noise the policy has; of a single round, the only one is the last."""
    for std, pays in ((0.05, True), (2.0, False)):
        found = [
            DOWN.noise(context(n, rounds=rounds), policy_std=std, pays_for_rate=pays)
            for n in range(1, rounds + 1)
        ]
        assert [each.start_std for each in found] == expected
        assert [each.final_std for each in found] == [None] * (rounds - 1) + [0.1]
        assert all(each.calm_from == 0.0 for each in found)


@pytest.mark.parametrize(
    ("std", "pays", "expected"),
    [
        (0.149, False, Noise(start_std=0.3)),
        (0.151, False, Noise()),
        (0.149, True, Noise(start_std=0.3, final_std=0.1, calm_from=0.85)),
        (0.151, True, Noise(final_std=0.1, calm_from=0.85)),
    ],
)
def test_it_is_put_back_where_half_more_than_calm_is_gone(
    std: float, pays: bool, expected: Noise
) -> None:
    back = PutBack(calm_std=0.1)
    assert back.noise(context(1), policy_std=std, pays_for_rate=pays) == expected
    # What is calm is told in the same units.
    wide = replace(back, calm_std=1.0)
    found = wide.noise(context(2), policy_std=std, pays_for_rate=False)
    assert found == Noise(start_std=0.15)


def test_noise_is_all_that_a_training_is_given() -> None:
    noise = Noise(start_std=0.3, final_std=0.2, calm_from=0.5)
    given = with_noise(PLAIN, noise)
    assert given == replace(PLAIN, exploration_std=0.3, final_std=0.2, calm_from=0.5)
    assert with_noise(given, Noise()) == PLAIN
