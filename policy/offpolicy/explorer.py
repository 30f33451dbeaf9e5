"""One actor of an off-policy training: environments, and a copy of the policy."""

from __future__ import annotations

import time
from dataclasses import dataclass, fields

import numpy as np

from policy.engines.actor import EnvPlan, Weights, load_weights
from policy.engines.trajectory import Origin

from .collecting import Log, collected, spread_time_outs
from .sac_cfg import SacCfg
from .tanh_actor import action_bound, new_actor


@dataclass(frozen=True, kw_only=True, eq=False)
class SentSteps:
    """Consecutive steps of one actor's environments, whose weights did not change
    meanwhile."""

    origin: Origin
    chunk: dict[str, np.ndarray]
    """A `Chunk` by the names of its fields."""
    log: Log
    collect_s: float
    """Time it took to collect."""

    @property
    def bytes(self) -> int:
        """Size of its arrays."""
        return sum(part.nbytes for part in self.chunk.values())


@dataclass(frozen=True, kw_only=True, eq=False)
class ExplorerPlan(EnvPlan):
    """All such an actor has to know before it begins."""

    sac: SacCfg
    """The learner's; an actor learns nothing itself."""
    sizes: tuple[int, ...]
    """Widths of the policy's hidden layers."""
    steps: int
    """Control steps it sends at a time."""

    def begin(self) -> Explorer:
        """The actor."""
        return Explorer(self)


class Explorer:
    """Takes steps with whatever weights it is given, and their noise."""

    def __init__(self, plan: ExplorerPlan) -> None:
        self._plan = plan
        self._env = plan.begin_env()
        obs_dim = self._env.get_observations()["policy"].shape[-1]
        bound = action_bound(self._env, plan.sac.most_action)
        self._actor = new_actor(plan.sac, obs_dim, bound, plan.sizes)
        spread_time_outs(self._env)

    def steps(self, weights: Weights, version: int, sequence: int) -> SentSteps:
        """The next steps of the policy `weights`.

        Args:
            weights: State of the network `actor`.
            version: What the learner calls them.
            sequence: Number of these steps.
        """
        begun_s = time.perf_counter()
        load_weights(self._actor, weights["actor"])
        chunk, log = collected(self._env, self._actor, self._plan.steps)
        return SentSteps(
            origin=Origin(self._plan.actor, sequence, version),
            chunk={
                part.name: getattr(chunk, part.name).numpy() for part in fields(chunk)
            },
            log=log,
            collect_s=time.perf_counter() - begun_s,
        )
