"""Other trainers: Gymnasium, Stable-Baselines3, and RSL-RL on a foreign environment."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from rsl_rl.env import VecEnv
from rsl_rl.runners import OnPolicyRunner
from rsl_rl.utils import check_nan
from tensordict import TensorDict
from torch import Tensor

from data.features import FEATURE_DIM, column
from gaitpref.adapters.gym_env import QuadrupedGymEnv, QuadrupedVectorEnv
from gaitpref.adapters.gym_registration import ENV_ID
from gaitpref.adapters.learned_vecenv import LearnedRewardEnv
from gaitpref.adapters.step_reward import StepReward
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import EnvCfg
from policy.robots.robot import load_robot
from policy.training.ppo import PpoCfg, to_rsl_rl
from rewardmodel import FitCfg, fit_reward, save_reward
from rewardmodel.models.storage import load_reward
from tests.rewardmodel.test_fit import answered


@pytest.fixture(scope="module")
def reward(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The directory of a learned reward."""
    directory = tmp_path_factory.mktemp("reward") / "reward"
    save_reward(fit_reward(answered(12, seed=5), FitCfg(), seed=0)[0], directory)
    return directory


def test_gymnasiums_checker_is_satisfied() -> None:
    """`make` gives an environment whose every call is as Gymnasium wants it."""
    env = gymnasium.make(ENV_ID)
    check_env(env.unwrapped, skip_render_check=True)
    assert env.observation_space.shape == (48,)
    assert isinstance(env.unwrapped, QuadrupedGymEnv)


def test_one_environment_ends_and_starts_as_gymnasium_wants() -> None:
    """A time-out truncates; the next reset begins an episode of full length."""
    env = gymnasium.make(ENV_ID, cfg=EnvCfg(episode_s=0.1))
    for _ in range(2):
        env.reset()
        ends = [env.step(np.zeros(12, np.float32))[2:4] for _ in range(5)]
        assert ends == [(False, False)] * 4 + [(False, True)]


def test_many_are_one_batch_and_reset_in_the_same_step() -> None:
    """What an episode ended with is in the infos, what began is the observation."""
    envs = gymnasium.make_vec(ENV_ID, num_envs=3, cfg=EnvCfg(episode_s=0.06))
    assert isinstance(envs.unwrapped, QuadrupedVectorEnv)
    assert envs.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP
    first, _ = envs.reset(seed=5)
    again, _ = envs.reset(seed=5)
    assert np.array_equal(first, again)
    rng = np.random.default_rng(0)
    infos: dict[str, Any] = {}
    actions = obs = np.zeros((3, 12), np.float32)
    for step in range(3):
        actions = rng.uniform(-0.2, 0.2, (3, 12)).astype(np.float32)
        obs, rewards, terminated, truncated, infos = envs.step(actions)
        assert obs in envs.observation_space
        assert rewards.shape == (3,)
        assert not terminated.any()
        assert truncated.all() == ("final_obs" in infos) == (step == 2)
    assert infos["_final_obs"].all()
    # The last observation holds the last action; a new episode has taken none.
    assert infos["final_obs"][:, 33:45] == pytest.approx(actions * 3.0)
    assert (obs[:, 33:45] == 0).all()


def test_one_and_many_pay_the_same_for_the_same() -> None:
    """The single environment is the first of a batch of one."""
    one = gymnasium.make(ENV_ID)
    many = gymnasium.make_vec(ENV_ID, num_envs=1)
    action = np.linspace(-0.2, 0.2, 12).astype(np.float32)
    assert np.array_equal(one.reset(seed=3)[0], many.reset(seed=3)[0][0])
    for _ in range(5):
        obs, paid, *_ = one.step(action)
        their_obs, their_paid, *_ = many.step(action[None])
        assert np.array_equal(obs, their_obs[0])
        assert paid == their_paid[0]


def test_a_learned_reward_is_taken_by_its_path(reward: Path) -> None:
    """What is paid is the score of the rows in `info`, and the known terms."""
    env = gymnasium.make(ENV_ID, reward=str(reward))
    task = gymnasium.make(ENV_ID)
    env.reset(seed=1)
    task.reset(seed=1)
    action = np.full(12, 0.1, np.float32)
    _, paid, _, _, info = env.step(action)
    _, task_paid, _, _, _ = task.step(action)
    rows = torch.from_numpy(info["features"])[None, None]
    score = float(load_reward(reward)(rows, torch.ones(1, 1, dtype=torch.bool)))
    torque = float(rows[..., column("joint_torque")].square().sum())
    assert paid == pytest.approx(0.02 * (score + 1.0 - 2e-5 * torque), abs=1e-6)
    assert info["task_reward"] == pytest.approx(task_paid)
    assert paid != pytest.approx(task_paid)


def test_a_reward_that_looks_back_sees_what_it_would_see_in_a_rollout() -> None:
    """Step by step with a window gives what the whole rollout gives."""
    features = torch.randn(
        7, 2, FEATURE_DIM, generator=torch.Generator().manual_seed(0)
    )
    starts = torch.zeros(7, 2, dtype=torch.bool)
    starts[0] = starts[4, 1] = True

    def gained(features: Tensor, starts: Tensor) -> Tensor:
        value = features[..., 0]
        before = torch.cat([value[:1], value[:-1]])
        return torch.where(starts, 0.0, value - before)

    step_by_step = StepReward(gained, history=2)
    paid = torch.stack(
        [step_by_step(*step) for step in zip(features, starts, strict=True)]
    )
    assert paid.equal(gained(features, starts))


def test_the_example_trains_with_stable_baselines3(
    tmp_path: Path, reward: Path
) -> None:
    """A few hundred steps of another trainer, on a learned reward."""
    pytest.importorskip("stable_baselines3", reason="the extra sb3 is not installed")
    path = Path(__file__).parents[2] / "examples" / "train_with_sb3.py"
    spec = importlib.util.spec_from_file_location("train_with_sb3", path)
    assert spec is not None and spec.loader is not None  # noqa: PT018
    example = importlib.util.module_from_spec(spec)
    sys.modules["train_with_sb3"] = example
    spec.loader.exec_module(example)
    cfg = example.ExampleCfg(
        reward=str(reward), steps=256, envs=8, steps_per_env=16, out=tmp_path / "p.zip"
    )
    with contextlib.redirect_stdout(io.StringIO()):
        model = example.train(cfg)
    assert model.num_timesteps == 256
    assert (tmp_path / "p.zip").is_file()


class Slider(VecEnv):
    """A foreign task: points on a rail; shares no code with our environment."""

    def __init__(self, num_envs: int) -> None:
        self.num_envs, self.num_actions, self.max_episode_length = num_envs, 1, 10
        self.episode_length_buf = torch.zeros(num_envs, dtype=torch.long)
        self.device: torch.device | str = "cpu"
        self.cfg = {"task": "slide"}
        self.place = torch.zeros(num_envs)

    @property
    def unwrapped(self) -> VecEnv:
        return self

    def get_observations(self) -> TensorDict:
        return TensorDict({"policy": self.place[:, None]}, batch_size=[self.num_envs])

    def step(
        self, actions: Tensor
    ) -> tuple[TensorDict, Tensor, Tensor, dict[str, Any]]:
        self.place = self.place + 0.1 * actions[:, 0].clamp(-1, 1)
        self.episode_length_buf += 1
        rows = torch.zeros(self.num_envs, FEATURE_DIM)
        rows[:, column("base_height")] = self.place[:, None]
        dones = self.episode_length_buf >= self.max_episode_length
        extras = {
            "features": rows,
            "time_outs": dones,
            "log": {"place": self.place.mean()},
        }
        self.place = torch.where(dones, 0.0, self.place)
        self.episode_length_buf[dones] = 0
        return self.get_observations(), -torch.ones(self.num_envs), dones, extras


def _height(features: Tensor, starts: Tensor) -> Tensor:
    return features[..., column("base_height")][..., 0]


def test_a_foreign_environment_is_paid_by_the_score() -> None:
    """Reward is score times step; its own is logged; all else passes through."""
    foreign = Slider(4)
    env = LearnedRewardEnv(foreign, _height, step_dt_s=0.5, weight=2.0)
    obs, paid, dones, extras = env.step(torch.ones(4, 1))
    check_nan(obs, paid, dones)
    assert paid == pytest.approx(torch.full((4,), 2.0 * 0.5 * 0.1))
    assert extras["log"]["reward/env"] == -1.0
    assert extras["log"]["place"] == pytest.approx(0.1)
    assert (env.num_envs, env.cfg, env.unwrapped) == (4, {"task": "slide"}, foreign)
    env.episode_length_buf = torch.full((4,), 9)
    assert foreign.episode_length_buf.tolist() == [9] * 4


def test_episodes_of_a_foreign_environment_begin_where_it_reset() -> None:
    seen: list[list[bool]] = []

    def score(features: Tensor, starts: Tensor) -> Tensor:
        seen.append(starts[-1].tolist())
        return features[..., 0]

    env = LearnedRewardEnv(Slider(2), score, step_dt_s=0.1)
    env.episode_length_buf = torch.tensor([8, 0])
    for _ in range(4):
        env.step(torch.zeros(2, 1))
    assert seen == [[True, True], [False, False], [True, False], [False, False]]


def test_rsl_rl_learns_what_the_score_asks_for() -> None:
    """Its own runner, on the wrapped foreign task, climbs the learned score."""
    torch.manual_seed(0)
    env = LearnedRewardEnv(Slider(16), _height, step_dt_s=0.5)
    cfg = to_rsl_rl(PpoCfg(num_envs=16, steps_per_env=10, hidden_sizes=(8,)))
    cfg["algorithm"]["class_name"] = "PPO"
    with contextlib.redirect_stdout(io.StringIO()):
        runner = OnPolicyRunner(env, cfg, log_dir=None, device="cpu")
        runner.learn(20)
    act = runner.get_inference_policy()
    obs = TensorDict({"policy": torch.zeros(1, 1)}, batch_size=[1])
    assert float(act(obs).detach()) > 0.3


def test_a_foreign_environment_without_rows_is_told_what_to_supply() -> None:
    env = LearnedRewardEnv(Slider(2), _height, step_dt_s=0.1, key="reward_features")
    message = (
        r"extras\['reward_features'\] must hold the feature rows \(2, 90\) .* before "
        "any reset; the environment put nothing there"
    )
    with pytest.raises(ValueError, match=message):
        env.step(torch.zeros(2, 1))


def test_our_own_environment_can_be_wrapped_too(reward: Path) -> None:
    """RSL-RL's plain PPO runs on it, as on any other."""
    cfg = EnvCfg()
    robot = load_robot(physics_dt_s=cfg.physics_dt_s)
    env = LearnedRewardEnv(
        QuadrupedEnv(robot, cfg, 4, seed=0),
        load_reward(reward),
        step_dt_s=cfg.control_dt_s,
    )
    rsl = to_rsl_rl(PpoCfg(num_envs=4, steps_per_env=8, hidden_sizes=(8,)))
    rsl["algorithm"]["class_name"] = "PPO"
    with contextlib.redirect_stdout(io.StringIO()):
        OnPolicyRunner(env, rsl, log_dir=None, device="cpu").learn(2)
