"""How long one training is, of what, and what it leaves on the way."""

from __future__ import annotations

from dataclasses import dataclass, field

from data.files.plain import ADDED_LATER, NONE_AS_BEFORE
from policy.env.env_cfg import EnvCfg
from policy.sim.making import SimCfg

from .ppo import PpoCfg


@dataclass(frozen=True, kw_only=True)
class TrainCfg:
    """One training run."""

    steps: int = 1_500_000
    """Environment steps over all environments."""
    env: EnvCfg
    """The environment."""
    ppo: PpoCfg
    """The algorithm."""
    seed: int = 0
    """Where all chance comes from."""
    checkpoints: int = 4
    """Policies kept on the way, evenly spaced, so that clips of them can differ."""
    save_every: int = 20
    """Iterations between two states a killed run can go on from."""
    exploration_std: float | None = None
    """Exploration noise to start from instead of that of the initial policy."""
    final_std: float | None = None
    """The most exploration noise there may be at the end, come down to linearly; a gait
    that only noise sets going is no gait."""
    sim: SimCfg | None = field(default=None, metadata=NONE_AS_BEFORE)
    """Where it runs; None is the CPU, on its threads."""
    calm_from: float = field(default=0.0, metadata=ADDED_LATER)
    """Share of the training after which it comes down, from the algorithm's `init_std`;
    at 0 from `exploration_std`, if that is given."""

    def std_limit(self, iteration: int) -> float | None:
        """The most exploration noise there may be after `iteration`."""
        if self.final_std is None:
            return None
        first = self.ppo.init_std
        if self.exploration_std is not None and not self.calm_from:
            first = self.exploration_std
        done = min(1.0, iteration / max(1, self.iterations))
        calm = max(0.0, done - self.calm_from) / max(1.0 - self.calm_from, 1e-9)
        return first + calm * (self.final_std - first)

    @property
    def iterations(self) -> int:
        """Updates it takes to reach `steps`."""
        return -(-self.steps // self.ppo.steps_per_iteration)

    @property
    def checkpoint_iterations(self) -> frozenset[int]:
        """Iterations after which a policy is kept, the last one left out."""
        parts = self.checkpoints + 1
        return frozenset(self.iterations * i // parts for i in range(1, parts)) - {0}
