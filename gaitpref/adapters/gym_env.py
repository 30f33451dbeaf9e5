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

from data.errors import GaitprefError
from data.features import JOINTS
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import EnvCfg
from policy.env.feature_row import OBS_DIM
from policy.env.world import in_world
from policy.robots.robot import load_robot
from policy.sim.batch_sim import BatchSim

from .frames import frames_for, metadata_of
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
        alive: float,
        cfg: EnvCfg | None,
        threads: int,
        render_mode: str | None,
    ) -> None:
        cfg = cfg or EnvCfg()
        path = None if robot is None else Path(robot)
        model = load_robot(path, physics_dt_s=cfg.physics_dt_s)
        model = in_world(model, cfg)
        sim = BatchSim(model, num_envs, threads=threads)
        self.env = QuadrupedEnv(model, cfg, num_envs, seed=0, sim=sim, keep_final=True)
        self._reward = StepReward(
            reward_named(reward, model, cfg, keep_task=keep_task, alive=alive)
        )
        self._limit = cfg.action_limit
        self._frames = frames_for(model, render_mode)
        self._shown = self.env.sim.raw_state()[0]

    def reset(self, seed: int) -> np.ndarray:
        """Observations [N, 48] of fresh episodes, the same for the same seed."""
        self._reward.forget()
        obs = _array(self.env.reset(seed=seed)["policy"])
        self._shown = self.env.sim.raw_state()[0]
        return obs

    def step(self, actions: np.ndarray) -> dict[str, np.ndarray]:
        """What one control step led to; keys are those of `QuadrupedVectorEnv.step`.

        Raises:
            GaitprefError: `actions` are of another shape.
        """
        told = np.asarray(actions, dtype=np.float32)
        if told.shape != (self.env.num_envs, 12):
            raise GaitprefError(
                f"actions must have shape {(self.env.num_envs, 12)}, of a single "
                f"environment (12,): one number for each of {', '.join(JOINTS)}; got "
                f"{told.shape}"
            )
        scaled = torch.from_numpy(told) * self._limit
        obs, task, dones, extras = self.env.step(scaled)
        reward = self._reward(extras["features"], extras["starts"])
        reward = torch.where(extras["aborted"], 0.0, reward)
        self._shown = extras["final"][0]
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

    def pictures(self) -> tuple[np.ndarray, ...] | None:
        """A picture of every robot as the last step left it; None without a mode."""
        if self._frames is None:
            return None
        return tuple(self._frames(_array(qpos)) for qpos in self._shown)

    def close(self) -> None:
        """Give the renderer back."""
        if self._frames is not None:
            self._frames.close()
            self._frames = None


class QuadrupedGymEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """One quadruped that follows velocity commands.

    An action in [-1, 1] asks for joint offsets of up to `action_limit *
    action_scale_rad` from the home pose. `info` has the feature row (`features`) and
    what the hand-written reward would have paid (`task_reward`).
    """

    metadata = metadata_of(EnvCfg().control_dt_s, {})

    def __init__(
        self,
        *,
        robot: str | Path | None = None,
        reward: str | Path = "task",
        keep_task: bool = False,
        alive: float = 0.0,
        cfg: EnvCfg | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Make the environment.

        Args:
            robot: MJCF file; the Go1 that ships by default.
            reward: `task`, a criterion, or the directory of a learned reward.
            keep_task: Keep the hand-written reward beside another one.
            alive: Paid per second without a fall, beside the task alone: who explores
                at random earns less than nothing, and would learn to fall early.
            cfg: Commands, episode, resets and all else.
            render_mode: `rgb_array` for pictures, as `RecordVideo` wants them; they
                need MuJoCo's offscreen renderer.

        Raises:
            GaitprefError: the robot or the reward cannot be used, or nothing can draw.
        """
        self._engine = _Engine(1, robot, reward, keep_task, alive, cfg, 1, render_mode)
        self.render_mode = render_mode
        self.metadata = metadata_of(self._engine.env.cfg.control_dt_s, {})
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
            name: rows[0]
            for name, rows in self._engine.step(np.asarray(action)[None]).items()
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

    def render(self) -> np.ndarray | None:
        """The picture [height, width, 3] of the last step; None without a mode."""
        pictures = self._engine.pictures()
        return None if pictures is None else pictures[0]

    def close(self) -> None:
        """Give the renderer back."""
        self._engine.close()


class QuadrupedVectorEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """N quadrupeds in one batch of MuJoCo; finished ones start again at once.

    What an episode ended with is in `infos["final_obs"]`, marked by
    `infos["_final_obs"]`. The rest is as in `QuadrupedGymEnv`, with N in front.
    """

    metadata = metadata_of(
        EnvCfg().control_dt_s, {"autoreset_mode": AutoresetMode.SAME_STEP}
    )

    def __init__(
        self,
        num_envs: int = 1,
        *,
        robot: str | Path | None = None,
        reward: str | Path = "task",
        keep_task: bool = False,
        alive: float = 0.0,
        cfg: EnvCfg | None = None,
        threads: int = 0,
        render_mode: str | None = None,
    ) -> None:
        """Make `num_envs` environments on `threads` threads, by default one a core.

        The other arguments are those of `QuadrupedGymEnv`.
        """
        self._engine = _Engine(
            num_envs, robot, reward, keep_task, alive, cfg, threads, render_mode
        )
        self.num_envs, self.render_mode = num_envs, render_mode
        self.metadata = metadata_of(
            self._engine.env.cfg.control_dt_s,
            {"autoreset_mode": AutoresetMode.SAME_STEP},
        )
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

    def render(self) -> tuple[np.ndarray, ...] | None:
        """A picture of every robot as the last step left it; None without a mode."""
        return self._engine.pictures()

    def close_extras(self, **kwargs: Any) -> None:
        """Give the renderer back."""
        self._engine.close()


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
