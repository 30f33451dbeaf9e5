"""The wrapper for others' environments on the interface of Isaac Lab's.

Isaac Lab needs its simulator and a GPU: what is stepped here has the shapes, types and
habits of `isaaclab_rl.rsl_rl.RslRlVecEnvWrapper` (version 2.3, on the task
Isaac-Velocity-Flat-Unitree-Go2-v0), recorded from its documentation and source, and no
physics. That its own environments run is not shown by it.
"""

from __future__ import annotations

import contextlib
import io
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from rsl_rl.env import VecEnv
from rsl_rl.runners import OnPolicyRunner
from tensordict import TensorDict
from torch import Tensor

from data.features import FEATURE_DIM, column
from gaitpref.adapters.learned_vecenv import LearnedRewardEnv
from policy.training.ppo import PpoCfg, to_rsl_rl

STEP_DT_S = 0.02
HEIGHT = column("base_height")


class IsaacLabShapes(VecEnv):
    """`extras` is one dictionary for good; ends are integers; a critic sees more."""

    def __init__(self, num_envs: int, max_episode_length: int = 6) -> None:
        self.num_envs, self.num_actions, self.device = num_envs, 12, "cpu"
        self.max_episode_length = max_episode_length
        self.unwrapped: Any = SimpleNamespace(
            episode_length_buf=torch.zeros(num_envs, dtype=torch.long),
            extras={},
            cfg=SimpleNamespace(decimation=4, is_finite_horizon=False),
        )

    @property
    def cfg(self) -> Any:
        return self.unwrapped.cfg

    @property
    def episode_length_buf(self) -> Tensor:
        return self.unwrapped.episode_length_buf

    @episode_length_buf.setter
    def episode_length_buf(  # pyright: ignore[reportIncompatibleVariableOverride]
        self, value: Tensor
    ) -> None:
        self.unwrapped.episode_length_buf = value

    def get_observations(self) -> TensorDict:
        groups = {"policy": 48, "critic": 52}
        return TensorDict(
            {name: torch.zeros(self.num_envs, width) for name, width in groups.items()},
            batch_size=[self.num_envs],
        )

    def step(
        self, actions: Tensor
    ) -> tuple[TensorDict, Tensor, Tensor, dict[str, Any]]:
        inner = self.unwrapped
        inner.episode_length_buf += 1
        rows = torch.zeros(self.num_envs, FEATURE_DIM)
        rows[:, HEIGHT] = actions[:, :1]
        time_outs = inner.episode_length_buf >= self.max_episode_length
        terminated = actions[:, 1] > 1e3
        inner.extras["features"] = rows
        inner.extras["log"] = {"Episode_Reward/track_lin_vel_xy_exp": torch.tensor(0.5)}
        inner.extras["time_outs"] = time_outs
        dones = terminated | time_outs
        inner.episode_length_buf[dones] = 0
        reward = torch.full((self.num_envs,), 7.0)
        return self.get_observations(), reward, dones.to(torch.long), inner.extras


def score(features: Tensor, starts: Tensor) -> Tensor:
    return features[..., HEIGHT][..., 0] + 10.0 * starts


def test_steps_are_paid_and_what_isaac_lab_told_is_passed_on() -> None:
    theirs = IsaacLabShapes(3, max_episode_length=2)
    env = LearnedRewardEnv(theirs, score, step_dt_s=STEP_DT_S, env_weight=0.1)
    paid_before = None
    for start in (10.0, 0.0, 10.0):
        obs, paid, dones, extras = env.step(torch.ones(3, 12))
        assert paid == pytest.approx(torch.full((3,), STEP_DT_S * (1 + start) + 0.7))
        assert (obs["policy"].shape, obs["critic"].shape) == ((3, 48), (3, 52))
        assert dones.dtype == torch.long
        assert extras["time_outs"].tolist() == dones.bool().tolist()
        told = extras["log"]
        assert float(told["Episode_Reward/track_lin_vel_xy_exp"]) == 0.5
        assert float(told["reward/env"]) == 7.0
        assert paid_before is not extras
        paid_before = extras
    assert "reward/env" not in theirs.unwrapped.extras["log"]
    assert env.unwrapped is theirs.unwrapped


def test_rsl_rl_trains_on_it_with_lengths_drawn_at_random() -> None:
    torch.manual_seed(0)
    env = LearnedRewardEnv(IsaacLabShapes(8), score, step_dt_s=STEP_DT_S)
    cfg = to_rsl_rl(PpoCfg(num_envs=8, steps_per_env=6, hidden_sizes=(8,)))
    cfg["algorithm"]["class_name"] = "PPO"
    cfg["obs_groups"] = {"actor": ["policy"], "critic": ["critic"]}
    with contextlib.redirect_stdout(io.StringIO()):
        runner = OnPolicyRunner(env, cfg, log_dir=None, device="cpu")
        runner.learn(2, init_at_random_ep_len=True)
    act = runner.get_inference_policy()
    assert act(env.get_observations()).shape == (8, 12)
