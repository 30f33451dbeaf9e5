"""The environment as Gymnasium knows environments, one robot or many.

Shapes: N environments, F feature columns.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from torch import Tensor

from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import EnvCfg
from policy.env.feature_row import OBS_DIM
from policy.env.world import in_world
from policy.robots.robot import load_robot
from policy.sim.batch_sim import BatchSim

from .step_reward import StepReward, reward_named

OBS_LIMIT = 1e6
"""No observation of a simulation that has not diverged is larger."""


class _Engine:
    """N robots and the reward they get, behind both of Gymnasium's interfaces."""

    def __init__(
        self,
        num_envs: int,
        robot: str | Path | None,
        reward: str | Path,
        keep_task: bool,
        cfg: EnvCfg | None,
        threads: int,
    ) -> None:
        cfg = cfg or EnvCfg()
        path = None if robot is None else Path(robot)
        model = load_robot(path, physics_dt_s=cfg.physics_dt_s)
        model = in_world(model, cfg)
        sim = BatchSim(model, num_envs, threads=threads)
        self.env = QuadrupedEnv(model, cfg, num_envs, seed=0, sim=sim, keep_final=True)
        self._reward = StepReward(reward_named(reward, model, cfg, keep_task=keep_task))
        self._limit = cfg.action_limit

    def reset(self, seed: int) -> np.ndarray:
        """Observations [N, 48] of fresh episodes, the same for the same seed."""
        self._reward.forget()
        return _array(self.env.reset(seed=seed)["policy"])

    def step(self, actions: np.ndarray) -> dict[str, np.ndarray]:
        """What one control step led to; keys are those of `QuadrupedVectorEnv.step`."""
        scaled = torch.from_numpy(np.asarray(actions, dtype=np.float32)) * self._limit
        obs, task, dones, extras = self.env.step(scaled)
        reward = self._reward(extras["features"], extras["starts"])
        reward = torch.where(extras["aborted"], 0.0, reward)
        terminated = extras["fallen"]
        # Of a diverged simulation nothing can be told.
        final = extras["final"][2].masked_fill(extras["aborted"][:, None], 0.0)
        return {
            "obs": _array(obs["policy"]),
            "final_obs": _array(final),
            "reward": _array(reward).astype(np.float64),
            "terminated": _array(terminated),
            "truncated": _array(dones & ~terminated),
            "task_reward": _array(task),
            "features": _array(extras["features"]),
        }


class QuadrupedGymEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """One quadruped that follows velocity commands.

    An action in [-1, 1] asks for joint offsets of up to `action_limit *
    action_scale_rad` from the home pose. `info` has the feature row (`features`) and
    what the hand-written reward would have paid (`task_reward`).
    """

    metadata = {"render_modes": []}  # noqa: RUF012 - Gymnasium's own form

    def __init__(
        self,
        *,
        robot: str | Path | None = None,
        reward: str | Path = "task",
        keep_task: bool = False,
        cfg: EnvCfg | None = None,
    ) -> None:
        """Make the environment.

        Args:
            robot: MJCF file; the Go1 that ships by default.
            reward: `task`, a criterion, or the directory of a learned reward.
            keep_task: Keep the hand-written reward beside another one.
            cfg: Commands, episode, resets and all else.
        """
        self._engine = _Engine(1, robot, reward, keep_task, cfg, threads=1)
        self.observation_space, self.action_space = _spaces()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode; with equal seeds, equal episodes."""
        super().reset(seed=seed)
        return self._engine.reset(_draw_seed(self.np_random))[0], {}

    def step(
        self, action: np.ndarray
    ) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Apply `action` [12] for one control step."""
        led_to = {
            name: rows[0] for name, rows in self._engine.step(action[None]).items()
        }
        info = {
            "features": led_to["features"],
            "task_reward": float(led_to["task_reward"]),
        }
        return (
            led_to["final_obs"],
            float(led_to["reward"]),
            bool(led_to["terminated"]),
            bool(led_to["truncated"]),
            info,
        )


class QuadrupedVectorEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """N quadrupeds in one batch of MuJoCo; finished ones start again at once.

    What an episode ended with is in `infos["final_obs"]`, marked by
    `infos["_final_obs"]`. The rest is as in `QuadrupedGymEnv`, with N in front.
    """

    metadata = {  # noqa: RUF012 - Gymnasium's own form
        "render_modes": [],
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        *,
        robot: str | Path | None = None,
        reward: str | Path = "task",
        keep_task: bool = False,
        cfg: EnvCfg | None = None,
        threads: int = 0,
    ) -> None:
        """Make `num_envs` environments on `threads` threads, by default all CPUs.

        The other arguments are those of `QuadrupedGymEnv`.
        """
        self._engine = _Engine(num_envs, robot, reward, keep_task, cfg, threads)
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = _spaces()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start all episodes; with equal seeds, equal episodes."""
        super().reset(seed=seed)
        return self._engine.reset(_draw_seed(self.np_random)), {}

    def step(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Apply `actions` [N, 12] for one control step."""
        led_to = self._engine.step(actions)
        done = led_to["terminated"] | led_to["truncated"]
        everywhere = np.ones(self.num_envs, dtype=bool)
        infos: dict[str, Any] = {
            "features": led_to["features"],
            "_features": everywhere,
            "task_reward": led_to["task_reward"],
            "_task_reward": everywhere.copy(),
        }
        if done.any():
            infos |= {"final_obs": led_to["final_obs"], "_final_obs": done}
        return (
            led_to["obs"],
            led_to["reward"],
            led_to["terminated"],
            led_to["truncated"],
            infos,
        )


def _spaces() -> tuple[spaces.Box, spaces.Box]:
    """Observations and actions of one robot."""
    return (
        spaces.Box(-OBS_LIMIT, OBS_LIMIT, (OBS_DIM,), np.float32),
        spaces.Box(-1.0, 1.0, (12,), np.float32),
    )


def _draw_seed(rng: np.random.Generator) -> int:
    return int(rng.integers(2**31))


def _array(values: Tensor) -> np.ndarray:
    """A copy of `values`: what Gymnasium hands out must not change afterwards."""
    return values.detach().cpu().numpy().copy()
