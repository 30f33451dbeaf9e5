"""Training with actors, behind the one `train` of `policy.training`."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from policy.env.randomise import make_env
from policy.robots.robot import Robot
from policy.training.ppo import IterationStats, Runner
from policy.training.train_cfg import TrainCfg

from .actor import ActorPlan, weights_of
from .actor_pool import ActorPool, Counts, seed_of_actor
from .actors_cfg import ActorsCfg, ActorsError
from .asynchronous import absorb, apply_gradients
from .learner import VTracePpo
from .ray_cluster import ray_for
from .trajectory import Gradient, Trajectory


@dataclass(frozen=True, kw_only=True)
class WithActors:
    """An engine of `train`: rollouts come from actors on Ray."""

    cfg: ActorsCfg
    tell: Callable[[str], None] = lambda line: None
    """Gets a line about an actor that died."""

    def __call__(self, robot: Robot, cfg: TrainCfg, seed: int) -> Runner:
        """The runner of a training."""
        return ActorsRunner(robot, cfg, self.cfg, seed=seed, tell=self.tell)


class ActorsRunner(Runner):
    """`Runner` that learns from what actors send."""

    alg: VTracePpo  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(
        self,
        robot: Robot,
        cfg: TrainCfg,
        actors: ActorsCfg,
        *,
        seed: int,
        tell: Callable[[str], None],
    ) -> None:
        require_for_actors(cfg, actors)
        # One environment, which says what there is to see and scores by the task.
        env = make_env(robot, cfg.env, 1, seed=seed, threads=1)
        super().__init__(env, cfg.ppo, algorithm=VTracePpo)
        self.alg.correction = actors.correction
        self._robot, self._cfg, self._actors = robot, cfg, actors
        self._envs = actors.share_of(cfg.ppo.num_envs)
        self._seed, self._tell = seed, tell
        self._sequences: dict[int, int] = {}
        self._counts = Counts()

    @property
    def told(self) -> dict[str, Any]:
        """What beside its settings makes a training what it is."""
        return {"update": self._actors.update}

    def begin(self) -> None:
        """Prepare the first iteration: actors begin by themselves."""

    def snapshot(self) -> dict[str, Any]:
        """How far each actor has come, what became of what it sent, and the learner's
        chance.

        Their environments are theirs: a training that goes on begins new episodes.
        """
        return {
            "torch_rng": torch.get_rng_state(),
            "sequences": dict(self._sequences),
            "counts": self._counts.snapshot(),
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go on from what `snapshot` gave, among other things."""
        torch.set_rng_state(snapshot["torch_rng"])
        self._sequences = dict(snapshot["sequences"])
        self._counts = Counts.restored(snapshot.get("counts", {}))

    def learn(
        self,
        num_learning_iterations: int,
        on_iteration: Callable[[IterationStats], bool],
    ) -> None:
        """See `Learning.learn`."""
        if self.current_learning_iteration >= num_learning_iterations:
            return
        self.alg.train_mode()
        gradients = self._actors.update == "gradients"
        iterate = self._along_gradients if gradients else self._from_rollouts
        with ray_for(self._actors) as ray:
            pool = self._pool(ray)
            pool.hand_out(self._weights(), pool.version)
            while self.current_learning_iteration < num_learning_iterations:
                pool.counts.lags.clear()
                stats = iterate(pool)
                self._remember(pool)
                if not on_iteration(stats):
                    return
                # After it: noise may have been brought down there.
                pool.hand_out(self._weights(), pool.version + 1)

    def _from_rollouts(self, pool: ActorPool) -> IterationStats:
        """Learn from as many rollouts as there are actors."""
        start_s = time.perf_counter()
        count = self._actors.actors
        is_sync = self._actors.update == "sync"
        rollouts: list[Trajectory] = []
        while len(rollouts) < count:
            sent = pool.next(count - len(rollouts) if is_sync else count)
            assert isinstance(sent, Trajectory)
            rollouts.append(sent)
        if is_sync:
            # Which one came first is no matter of the training.
            rollouts.sort(key=lambda each: (each.origin.actor, each.origin.sequence))
        else:
            pool.ask(count)
        collected_s = time.perf_counter()
        with torch.inference_mode():
            last = self.alg.adopt(rollouts)
            scalars = self.figures()
            self.alg.compute_returns(last)
        losses = self.alg.update()
        scalars |= {"actors/clipped_share": self.alg.clipped_share, **pool.figures}
        self.current_learning_iteration += 1
        stop_s = time.perf_counter()
        return self._stats(scalars, losses, start_s, collected_s, stop_s)

    def _along_gradients(self, pool: ActorPool) -> IterationStats:
        """Take a step along each of as many gradients as there are actors."""
        start_s = time.perf_counter()
        count, taken = self._actors.actors, []
        for number in range(count):
            sent = pool.next(count)
            assert isinstance(sent, Gradient)
            apply_gradients(self.alg, sent.actor, sent.critic)
            for name, moments in sent.moments.items():
                absorb(getattr(self.alg, name), moments)
            taken.append(sent)
            if number < count - 1:
                pool.hand_out(self._weights(), pool.version + 1)
        names = taken[0].scalars
        scalars = {
            n: float(np.mean([each.scalars[n] for each in taken])) for n in names
        }
        self.alg.mean_reward = float(np.mean([each.mean_reward for each in taken]))
        self.alg.reference_kl = 0.0
        # What its noise is, it knows once it has acted.
        self.alg.actor(self.env.get_observations(), stochastic_output=True)
        self.current_learning_iteration += 1
        stop_s = time.perf_counter()
        return self._stats(scalars | pool.figures, {}, start_s, stop_s, stop_s)

    def _weights(self) -> Any:
        networks = {"actor": self.alg.actor}
        if self._actors.update == "gradients":
            networks["critic"] = self.alg.critic
        return weights_of(networks)

    def _pool(self, ray: Any) -> ActorPool:
        gradients = self._actors.update == "gradients"
        count = self._actors.actors
        return ActorPool(
            ray,
            self._plan,
            [self._sequences.get(actor, 0) for actor in range(count)],
            method="gradient" if gradients else "rollout",
            most_lag=self._actors.most_lag * (count if gradients else 1),
            counts=self._counts,
            tell=self._tell,
        )

    def _plan(self, actor: int, sequence: int) -> ActorPlan:
        gradients = self._actors.update == "gradients"
        return ActorPlan(
            actor=actor,
            robot_name=self._robot.name,
            robot_mjcf=self._robot.mjcf,
            env=self._cfg.env,
            ppo=self._cfg.ppo,
            num_envs=self._envs,
            seed=seed_of_actor(self._seed, actor, sequence),
            reward_fn=self.alg.reward_fn if gradients else None,
        )

    def _remember(self, pool: ActorPool) -> None:
        self._sequences |= pool.sequences


def require_for_actors(cfg: TrainCfg, actors: ActorsCfg) -> None:
    """Refuse what needs all environments, or all rollouts, in one place.

    Raises:
        ActorsError: there is such a thing in the settings.
    """
    if cfg.env.curriculum is not None:
        raise ActorsError(
            "a curriculum widens the commands of all environments together, and those "
            "of actors do not know of one another: leave out --curriculum, or --actors"
        )
    if cfg.sim is not None:
        raise ActorsError(
            "actors simulate on the threads of their processors: leave out --device "
            "and --sim, or --actors"
        )
    ppo = cfg.ppo
    if actors.update == "gradients" and (ppo.bonus or ppo.kl_penalty or ppo.mirror):
        raise ActorsError(
            "actors that send gradients know no exploration bonus, no KL penalty and "
            "no mirror: leave these out, or give --update vtrace"
        )
