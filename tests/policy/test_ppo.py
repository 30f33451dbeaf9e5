"""PPO with a handed-in reward: arithmetic of the rollout, resume, policy files."""

from __future__ import annotations

import math
import os
import signal
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
import torch
from rsl_rl.algorithms import PPO as RslRlPpo
from torch import Tensor

from data.features import column
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import CommandCfg, EnvCfg
from policy.robots.robot import Robot, load_robot
from policy.training.checkpoint import PolicyError, load_policy
from policy.training.ppo import IterationStats, PpoCfg, RewardPpo, Runner, to_rsl_rl
from policy.training.train import train
from policy.training.train_cfg import TrainCfg

ENV = EnvCfg(episode_s=0.4, commands=CommandCfg(resample_s=math.inf))
PPO = PpoCfg(num_envs=4, steps_per_env=24, hidden_sizes=(8,), init_std=0.1)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot(physics_dt_s=ENV.physics_dt_s)


def _cfg(iterations: int, seed: int = 0) -> TrainCfg:
    return TrainCfg(
        steps=iterations * PPO.steps_per_iteration, env=ENV, ppo=PPO, seed=seed
    )


def _ones(features: Tensor, starts: Tensor) -> Tensor:
    return torch.ones(starts.shape)


def test_rsl_rl_gets_a_new_dictionary_every_time() -> None:
    """RSL-RL mutates what it is given."""
    assert to_rsl_rl(PPO) is not to_rsl_rl(PPO)
    assert to_rsl_rl(PPO) == to_rsl_rl(PPO)


def test_time_outs_are_bootstrapped_and_falls_are_not(robot: Robot) -> None:
    """At a time-out the stored reward is r + gamma V(s); GAE then stops there.

    With reward 1, a step before the time-out has the return worked out by hand.
    """
    torch.manual_seed(0)
    env = QuadrupedEnv(robot, ENV, 4, seed=0)
    runner = Runner(env, PPO)
    runner.alg.reward_fn = _ones
    obs = env.get_observations()
    with torch.inference_mode():
        for _ in range(24):
            obs, reward, dones, extras = env.step(runner.alg.act(obs))
            runner.alg.process_env_step(obs, reward, dones, extras)
        runner.alg.compute_returns(obs)
    storage = runner.alg.storage
    gamma, lam = PPO.gamma, PPO.lam
    values, rewards = storage.values[..., 0], storage.rewards[..., 0]
    # Episodes of 20 steps: step 19 is the time-out of all environments that stand.
    assert storage.dones[19, :, 0].all()
    assert rewards[19].allclose(1.0 + gamma * values[19])
    assert rewards[:19].eq(1.0).all()
    returns = storage.returns[..., 0]
    assert returns[19].allclose(rewards[19])
    delta_18 = 1.0 + gamma * values[19] - values[18]
    advantage_19 = rewards[19] - values[19]
    expected = values[18] + delta_18 + gamma * lam * advantage_19
    assert returns[18].allclose(expected, atol=1e-6)


def test_a_reward_sees_the_rows_and_the_starts(robot: Robot) -> None:
    """The whole rollout is handed over once, with episode starts where resets were."""
    seen: list[tuple[Tensor, Tensor]] = []

    def score(features: Tensor, starts: Tensor) -> Tensor:
        seen.append((features.clone(), starts.clone()))
        return features[..., column("base_height")][..., 0]

    env = QuadrupedEnv(robot, ENV, 4, seed=0)
    runner = Runner(env, PPO)
    runner.alg.reward_fn = score
    runner.learn(1, lambda stats: True)
    ((features, starts),) = seen
    assert features.shape == (24, 4, 90)
    dones = runner.alg.storage.dones[..., 0].bool()
    assert starts[0].all()
    assert dones.any()
    assert starts[1:].equal(dones[:-1])


def test_the_update_is_that_of_rsl_rl(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Actor and critic in a thread each learn the same, to the last bit."""

    def trained() -> tuple[dict[str, Tensor], dict[str, float]]:
        torch.manual_seed(0)
        runner = Runner(QuadrupedEnv(robot, ENV, 16, seed=0), replace(PPO, num_envs=16))
        stats: list[IterationStats] = []
        runner.learn(3, lambda done: stats.append(done) or True)
        networks = {
            f"{name}.{key}": value
            for name in ("actor", "critic")
            for key, value in getattr(runner.alg, name).state_dict().items()
        }
        losses = {k: v for k, v in stats[-1].scalars.items() if k.startswith("loss/")}
        return networks, losses

    weights, losses = trained()
    monkeypatch.setattr(RewardPpo, "update", RslRlPpo.update)
    expected, expected_losses = trained()
    assert all(weights[key].equal(expected[key]) for key in expected)
    assert losses == pytest.approx(expected_losses)


class Elapsed:
    """Rewards a step with the number of steps since its start, 30 at most."""

    history_steps = 30

    def __call__(self, features: Tensor, starts: Tensor) -> Tensor:
        steps = torch.arange(len(starts))[:, None]
        begun = torch.where(starts, steps, -100).cummax(dim=0).values
        # Where no start is in sight the episode began before the first step shown.
        unseen = begun < 0
        return torch.where(unseen, 1000.0, (steps - begun).float()).clamp(max=30.0)


def test_a_reward_that_looks_back_sees_the_rollout_before(robot: Robot) -> None:
    """Rollouts of 24 steps, episodes of 20: nothing is forgotten at their border."""
    runner = Runner(QuadrupedEnv(robot, ENV, 4, seed=0), PPO)
    seen: list[Tensor] = []

    class Recorded(Elapsed):
        def __call__(self, features: Tensor, starts: Tensor) -> Tensor:
            assert len(features) == (24 if not seen else min(24 + 30, 24 * 2))
            rewards = super().__call__(features, starts)
            seen.append(rewards[-24:].clone())
            return rewards

    runner.alg.reward_fn = Recorded()
    runner.learn(2, lambda stats: True)
    assert len(seen) == 2
    assert float(seen[1].max()) < 30.0


def test_a_resumed_run_still_knows_what_came_before(
    robot: Robot, tmp_path: Path
) -> None:
    """Two iterations and two more are the same as four, also for such a reward."""
    whole = train(tmp_path / "whole", robot, _cfg(4), reward_fn=Elapsed())
    train(tmp_path / "parts", robot, _cfg(2), reward_fn=Elapsed())
    parts = train(tmp_path / "parts", robot, _cfg(4), reward_fn=Elapsed(), resume=True)
    assert whole.policy.read_bytes() == parts.policy.read_bytes()


def test_a_reward_that_is_not_finite_stops_the_run(robot: Robot) -> None:
    """NaN is never replaced: the message names the environments."""

    def score(features: Tensor, starts: Tensor) -> Tensor:
        values = torch.zeros(starts.shape)
        values[3, 2] = torch.nan
        return values

    runner = Runner(QuadrupedEnv(robot, ENV, 4, seed=0), PPO)
    runner.alg.reward_fn = score
    with pytest.raises(FloatingPointError, match=r"environments \[2\]"):
        runner.learn(1, lambda stats: True)


def test_two_runs_with_one_seed_are_equal(robot: Robot, tmp_path: Path) -> None:
    """The policy files are the same bytes; another seed gives others."""
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        train(tmp_path / name, robot, _cfg(3, seed))
    first, second, third = (
        (tmp_path / name / "policy.pt").read_bytes() for name in "abc"
    )
    assert first == second
    assert first != third


def test_ctrl_c_leaves_what_resume_goes_on_from(robot: Robot, tmp_path: Path) -> None:
    """Interrupted after two of six iterations and resumed: as if never interrupted."""
    train(tmp_path / "whole", robot, _cfg(6))

    def interrupt(stats: IterationStats) -> None:
        if stats.iteration == 2:
            os.kill(os.getpid(), signal.SIGINT)

    out = tmp_path / "cut"
    result = train(out, robot, _cfg(6), on_iteration=interrupt)
    assert not result.finished
    assert load_policy(out / "policy.pt").info.steps == result.steps
    result = train(out, robot, _cfg(6), resume=True)
    assert result.finished
    whole = (tmp_path / "whole/policy.pt").read_bytes()
    assert (out / "policy.pt").read_bytes() == whole


def test_a_run_with_other_settings_is_not_resumed(robot: Robot, tmp_path: Path) -> None:
    """Resuming is refused where the result would be neither the old nor the new run."""
    train(tmp_path, robot, _cfg(1))
    other = replace(_cfg(2), ppo=replace(PPO, gamma=0.9))
    with pytest.raises(PolicyError, match="other settings"):
        train(tmp_path, robot, other, resume=True)


def test_training_goes_on_from_a_policy(robot: Robot, tmp_path: Path) -> None:
    """Steps add up, and the drift from the first policy is reported."""
    first = train(tmp_path / "a", robot, _cfg(2)).policy
    stats: list[IterationStats] = []
    train(tmp_path / "b", robot, _cfg(3), init=first, on_iteration=stats.append)
    info = load_policy(tmp_path / "b/policy.pt").info
    assert info.steps == 5 * PPO.steps_per_iteration
    assert stats[0].scalars["policy/reference_kl"] == pytest.approx(0.0, abs=1e-5)
    assert abs(stats[-1].scalars["policy/reference_kl"]) > 1e-4


def test_noise_comes_down_in_the_end(robot: Robot, tmp_path: Path) -> None:
    """In the second half of eight iterations, from what the algorithm began with."""
    stats: list[IterationStats] = []
    cfg = replace(_cfg(8), final_std=0.02, calm_from=0.5)
    train(tmp_path, robot, cfg, on_iteration=stats.append)
    found = [each.scalars["policy/std"] for each in stats]
    assert min(found[:4]) > 0.09
    assert all(later < earlier for earlier, later in pairwise(found[4:]))
    assert found[-1] < 0.05


def test_a_policy_file_is_enough_to_act(robot: Robot, tmp_path: Path) -> None:
    """Loaded with weights only, it gives the actions of the network that was saved."""
    train(tmp_path, robot, _cfg(1))
    policy = load_policy(tmp_path / "policy.pt")
    assert policy.robot().model_sha256 == robot.model_sha256
    obs = torch.randn(5, 48, generator=torch.Generator().manual_seed(0))
    assert policy(obs).shape == (5, 12)
    noisy = policy(obs, torch.ones(5, 12))
    assert (noisy - policy(obs)).allclose(policy.std.expand(5, 12), atol=1e-6)


@pytest.mark.parametrize("damage", ["missing", "cut", "text", "foreign"])
def test_a_damaged_policy_is_named(tmp_path: Path, damage: str) -> None:
    """One line that names the file, whatever is wrong with it."""
    path = tmp_path / "policy.pt"
    if damage == "text":
        path.write_text("not a policy")
    elif damage == "foreign":
        torch.save({"weights": torch.zeros(3)}, path)
    elif damage == "cut":
        torch.save({"actor_state_dict": {"w": torch.zeros(1000)}}, path)
        path.write_bytes(path.read_bytes()[:600])
    with pytest.raises(PolicyError, match=r"policy\.pt") as caught:
        load_policy(path)
    assert "\n" not in str(caught.value)
