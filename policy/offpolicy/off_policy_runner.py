"""Training off-policy, behind the one `train` of `policy.training`.

Shapes: S control steps of an iteration, N environments, D numbers of an observation.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from data.features import column
from data.files.plain import to_plain
from policy.engines.actors_cfg import ActorsCfg
from policy.env.randomise import make_env
from policy.parallel.ranks import ALONE
from policy.robots.robot import Robot
from policy.training.mirror import mirror_of
from policy.training.ppo import IterationStats
from policy.training.reward_ppo import figures_of
from policy.training.train_cfg import TrainCfg

from .as_policy import begin_from, described, policy_states
from .collecting import Here, Source, Tell
from .distance import action_distance
from .from_actors import FromActors
from .memory import Memory
from .possible import require_possible
from .remembered import contents_of
from .ring import Chunk
from .sac import Sac
from .sac_cfg import SacCfg
from .tanh_actor import action_bound

STD_FROM = 4096
"""Remembered steps over which the noise of a policy file is a mean."""


@dataclass(frozen=True, kw_only=True)
class OffPolicy:
    """An engine of `train`: learns from a memory instead of the last rollout."""

    cfg: SacCfg = field(default_factory=SacCfg)
    """How it learns."""
    replay: tuple[Path, ...] = ()
    """Data sets, or directories of off-policy trainings, that memory begins with."""
    offline: bool = False
    """Take no new step: learn from what is in memory alone."""
    actors: ActorsCfg | None = None
    """Who takes new steps; None is this process."""
    tell: Tell = lambda line: None
    """Gets a line about what was read, what was scored again, and who died."""

    def __call__(self, robot: Robot, cfg: TrainCfg, seed: int) -> OffPolicyRunner:
        """The runner of a training.

        Raises:
            GaitprefError: settings that only PPO has, or that do not go together.
        """
        require_possible(
            cfg, replay=self.replay, offline=self.offline, actors=self.actors
        )
        return OffPolicyRunner(robot, cfg, self, seed=seed)


class OffPolicyRunner:
    """Collects a few steps of all environments, remembers them, learns from memory."""

    def __init__(
        self, robot: Robot, cfg: TrainCfg, engine: OffPolicy, *, seed: int
    ) -> None:
        self.ranks = ALONE
        envs, actors = cfg.ppo.num_envs, engine.actors
        # Where actors act, one here says what there is to see, and scores.
        here = envs if actors is None else 1
        self.env = make_env(robot, cfg.env, here, seed=seed, sim=cfg.sim)
        self.device = str(self.env.device)
        self.sac, self.engine = engine.cfg, engine
        obs_dim = self.env.get_observations()["policy"].shape[-1]
        self.ppo = described(cfg.ppo, obs_dim)
        bound = action_bound(self.env, self.sac.most_action)
        self.alg = Sac(self.sac, obs_dim, bound, cfg.ppo.hidden_sizes)
        if cfg.ppo.mirror:
            self.alg.mirror = mirror_of(self.env.robot).to(self.env.sim.device)
        self.memory = Memory(
            self.env, self.sac, envs, engine.tell, robot_sha256=robot.model_sha256
        )
        self.ring = self.memory.ring
        self._source: Source = Here(self.env, self.alg.actor, cfg.ppo.steps_per_env)
        if actors is not None:
            self._source = FromActors(
                robot, cfg, actors, self.alg, self.ring, seed=seed, tell=engine.tell
            )
        self.current_learning_iteration = 0
        self._due = 0.0
        self._steps = cfg.steps
        self._searches = not engine.offline
        """What begins with a policy changes it, and needs no more noise than at the
        end."""

    @property
    def told(self) -> dict[str, Any]:
        """What beside its settings makes a training what it is."""
        told = {
            "algorithm": {"sac": to_plain(self.sac, whole=True)},
            "replay": [contents_of(path) for path in self.engine.replay],
            "offline": self.engine.offline,
        }
        actors = self.engine.actors
        if actors is None:
            return told
        return told | {"actors": "sync" if actors.update == "sync" else "meanwhile"}

    @property
    def std(self) -> None:
        """Nobody sets its noise: the temperature finds it."""
        return None

    def networks(self) -> dict[str, dict[str, Tensor]]:
        """Weights that must stay finite."""
        return self.alg.networks()

    def policy_states(self) -> dict[str, Any]:
        """State dictionaries of a policy file."""
        newest = self.ring.newest_obs(STD_FROM)
        obs = newest if len(newest) else self.env.get_observations()["policy"]
        return policy_states(self.alg, self.ppo, self.alg.actor.action_std(obs))

    def start_from(self, init: Path, payload: dict[str, Any]) -> None:
        """Take over the networks of the policy file `init`."""
        begin_from(self.alg, init, payload)
        self._searches = False

    def begin(self) -> None:
        """Fill memory with what is to be replayed."""
        self._source.begin()
        for path in self.engine.replay:
            self.alg.actor.normalizer.update(self.memory.replay(path))

    def snapshot(self) -> dict[str, Any]:
        """Memory, environments and chance."""
        return {
            **self.memory.snapshot(),
            "due": self._due,
            **self._source.snapshot(),
            "torch_rng": torch.get_rng_state(),
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go on from what `snapshot` gave, among other things."""
        self.memory.restore(snapshot)
        self._due = float(snapshot["due"])
        self._source.restore(snapshot)
        torch.set_rng_state(snapshot["torch_rng"])

    def learn(
        self,
        num_learning_iterations: int,
        on_iteration: Callable[[IterationStats], bool],
    ) -> None:
        """Run iterations until `num_learning_iterations` are done since the beginning.

        Args:
            num_learning_iterations: Total, those before a resume included.
            on_iteration: Called after each; answers whether to go on.
        """
        if self.current_learning_iteration >= num_learning_iterations:
            return
        with self._source.running():
            while self.current_learning_iteration < num_learning_iterations:
                if not on_iteration(self._iterate()):
                    return

    def _iterate(self) -> IterationStats:
        start_s = time.perf_counter()
        count = self.memory.relabel(self.alg.reward_fn)
        scalars = {"memory/relabelled": float(count)}
        if not self.engine.offline:
            scalars |= self._collect()
        elif count or not self.current_learning_iteration:
            self.memory.require_told(self.alg.reward_fn)
        collected_s = time.perf_counter()
        scalars |= self._improve()
        self.current_learning_iteration += 1
        return self._stats(scalars, start_s, collected_s, time.perf_counter())

    @torch.no_grad()
    def _collect(self) -> dict[str, float]:
        """Remember new steps and score them; figures of them."""
        chunk, log = self._source.collect()
        self.alg.actor.normalizer.update(chunk.obs.flatten(0, 1))
        paid = self.memory.add(chunk, self.alg.reward_fn)
        scalars = self._figures(chunk)
        scalars["train/return"] = float(paid.mean()) * self.env.cfg.episode_steps
        return scalars | log

    def _figures(self, chunk: Chunk) -> dict[str, float]:
        """Figures of a rollout by TensorBoard tag."""
        _, log = self.env.score(chunk.features)
        scalars = {name: float(value) for name, value in log.items()}
        minutes = chunk.starts.numel() * self.env.step_dt / 60.0
        falls = float(chunk.features[..., column("fallen")].sum())
        scalars["episode/falls_per_minute"] = falls / minutes
        return scalars | figures_of(self.alg.reward_fn)

    def _improve(self) -> dict[str, float]:
        """Learn from memory as much as the steps of an iteration are worth."""
        least = min(self.sac.learn_from, self.ring.rows * self.ring.columns)
        if self.ring.steps < least and not self.engine.offline:
            return {}
        self._due += self.ppo.steps_per_iteration * self.sac.updates_per_step
        updates = int(self._due)
        self._due -= updates
        done = self.current_learning_iteration * self.ppo.steps_per_iteration
        share = done / self._steps if self._searches else 1.0
        self.alg.joint_entropy = self.sac.joint_entropy_at(share)
        losses = self.alg.learn(self.ring, updates)
        return {f"loss/{name}": value for name, value in losses.items()}

    def _stats(
        self,
        scalars: dict[str, float],
        start_s: float,
        collected_s: float,
        stop_s: float,
    ) -> IterationStats:
        iteration = self.current_learning_iteration
        steps_per_s = self.ppo.steps_per_iteration / (stop_s - start_s)
        newest = self.ring.newest_obs(STD_FROM)
        if self.engine.offline:
            paid = self.ring.reward[self.ring.usable()]
            scalars["train/return"] = float(paid.mean()) * self.env.cfg.episode_steps
            scalars["offline/action_distance"] = action_distance(
                self.alg.actor, self.ring
            )
        found = {
            **scalars,
            "policy/std": float(self.alg.actor.action_std(newest).mean()),
            "memory/steps": float(self.ring.steps),
            "memory/megabytes": self.ring.megabytes,
            "perf/steps_per_s": steps_per_s,
            "perf/collect_s": collected_s - start_s,
            "perf/learn_s": stop_s - collected_s,
        }
        return IterationStats(
            iteration=iteration,
            steps=iteration * self.ppo.steps_per_iteration,
            steps_per_s=steps_per_s,
            mean_return=found.get("train/return", 0.0),
            scalars=found,
        )
