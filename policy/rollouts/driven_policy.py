"""A policy that somebody drives, and what it did last, as an episode.

Shapes: one environment; T steps.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np
import torch

from data.episodes.episode_records import Episode
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import EnvCfg
from policy.robots.robot import Robot
from policy.sim.batch_sim import BatchSim
from policy.sim.chosen import Listed
from policy.training.checkpoint import Policy

from .record_cfg import Command
from .rolled_out import LOGGED, episode_of, meta_of
from .rollout import RolloutStep, one_step

_FOREVER_S = 1e6
_ALIVE = torch.ones(1, dtype=torch.bool)


class DrivenPolicy:
    """A policy in an environment of one robot that never runs out of time."""

    def __init__(
        self, policy: Policy, robot: Robot, *, seed: int = 0, memory_s: float
    ) -> None:
        """
        Args:
            policy: Acts without exploration noise.
            robot: The robot.
            seed: Of the first start.
            memory_s: How far back `episode` may go.
        """
        self._policy, self._robot, self._seed = policy, robot, seed
        self._only = Listed(torch.zeros(1, dtype=torch.long))
        steps = round(memory_s / policy.info.env.control_dt_s)
        self._recent: deque[RolloutStep] = deque(maxlen=steps)
        self._command: Command = (0.0, 0.0, 0.0)
        self._env = self._new_env()

    @property
    def control_dt_s(self) -> float:
        """Time between two actions."""
        return self._policy.info.env.control_dt_s

    @property
    def steps(self) -> int:
        """Control steps, as far as remembered, since a start, a push or another
        command."""
        return len(self._recent)

    def begin(self) -> None:
        """Start anew, otherwise than before."""
        self._seed += 1
        self._env = self._new_env()
        self._recent.clear()

    def push(self, speed_m_s: tuple[float, float]) -> None:
        """Add to the speed of the base, world frame."""
        qpos, qvel = self._env.sim.raw_state()
        qvel[0, :2] += torch.tensor(speed_m_s)
        self._env.sim.reset(self._only, qpos, qvel)
        self._recent.clear()

    def step(self, command: Command) -> RolloutStep:
        """One control step under `command`; a robot that fell begins anew with it."""
        if command != self._command or (self._recent and self._recent[-1].fallen[0]):
            self._recent.clear()
        self._command = command
        self._env.fix_commands(torch.tensor([command]))
        step, _ = one_step(self._policy, self._env, _ALIVE)
        self._recent.append(step)
        return step

    def episode(self, steps: int) -> Episode:
        """The last `steps` as an episode; at least 1, and no more than there are."""
        kept = list(self._recent)[-steps:]
        rows = {
            name: np.stack([getattr(step, name)[0].numpy() for step in kept])
            for name in LOGGED
        }
        meta = meta_of(self._policy, self._env, command=self._command, seed=self._seed)
        meta.extra["driven"] = "by hand"
        return episode_of(kept[-1], rows, 0, meta, self._robot.mjcf)

    def _new_env(self) -> QuadrupedEnv:
        sim = BatchSim(self._robot, 1, threads=1)
        cfg = without_end(self._policy.info.env)
        return QuadrupedEnv(
            self._robot, cfg, 1, seed=self._seed, sim=sim, keep_final=True
        )


def without_end(cfg: EnvCfg) -> EnvCfg:
    """The environment a policy was trained in, whose time does not run out."""
    return replace(cfg, episode_s=_FOREVER_S)
