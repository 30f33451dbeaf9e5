"""How the off-policy learner is set; the defaults fit two CPU cores."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

from data.errors import GaitprefError
from data.features import FEATURE_DIM
from data.files.limits import POLICY_BYTES
from data.files.plain import NONE_AS_BEFORE

_OTHER_BYTES = 16
"""Of a step beside observation and feature row: marks, reward, version."""
_HIGH_UNTIL, _LOW_FROM = 0.5, 0.9
"""Shares of a training until which entropy is as at the start, and from which on as at
the end."""
OFFLINE_CLONE_WEIGHT = 1.0
"""`clone_weight` where nothing new is tried."""


@dataclass(frozen=True, kw_only=True)
class PriorityCfg:
    """Steps the critics err about are learned from more often (Schaul et al. 2016).

    Values are those of Ape-X (Horgan et al. 2018, arXiv 1803.00933).
    """

    alpha: float = 0.6
    """How much an error counts in how often a step is drawn; 0: not at all."""
    beta: float = 0.4
    """How far a step that is drawn more often counts less; 1: wholly."""
    least: float = 1e-3
    """Added to every error, in the critics' unit, so that no step is forgotten."""

    def __post_init__(self) -> None:
        for name in ("alpha", "beta"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name} must lie in [0, 1]: {getattr(self, name)}")
        if self.least <= 0.0:
            raise ValueError(f"least must be positive: {self.least}")


@dataclass(frozen=True, kw_only=True)
class SacCfg:
    """Soft actor-critic on a memory of steps.

    Haarnoja et al. 2018 (arXiv 1812.05905) maximise reward and entropy with a
    temperature that is found; the smaller of two critics is believed, and the actor
    changes more rarely, as in Fujimoto et al. 2018 (arXiv 1802.09477). Many robots side
    by side and large batches are those of FastTD3 (Seo et al. 2025, arXiv 2505.22642).
    """

    REMOVED: ClassVar = ("actor_sizes",)
    """Settings that older files have: the actor has the policy's sizes."""

    critic_sizes: tuple[int, ...] = (128, 128)
    """Widths of the hidden layers of each critic."""
    memory: int = 200_000
    """Steps that are remembered; the oldest make room."""
    learn_from: int = 4_000
    """Steps in memory before the first update."""
    updates_per_step: float = 0.5
    """Updates for each environment step."""
    batch: int = 256
    """Steps an update learns from."""
    actor_every: int = 2
    """Updates of the critics for each of the actor."""
    n_step: int = 3
    """Rewards of which a target is made before a critic is asked for the rest."""
    gamma: float = 0.98
    """Discount per control step."""
    tau: float = 0.01
    """Share by which the targets' networks follow the critics, each update."""
    learning_rate: float = 1e-3
    """Step size of actor and critics."""
    alpha_rate: float = 1e-3
    """Step size of the temperature."""
    first_alpha: float = 0.05
    """Temperature at the start, in the scaled reward's unit a nat."""
    joint_entropy: float = -0.1
    """Entropy a joint is to keep in the first half of the steps, nats; an action's
    share of its bound is 1. With less noise robots stand still and learn no better."""
    last_joint_entropy: float = -1.6
    """The same at the end; it comes down over most of the other half. What walks with
    much noise stands without: the noise is part of how it walks. So it is all along
    where a training begins with a policy, or takes no step."""
    reward_scale: float = 10.0
    """What rewards of a step are multiplied by before a critic learns them."""
    first_std: float = 0.7
    """Exploration noise at the start, in units of the action."""
    std_bounds: tuple[float, float] = (0.02, 1.5)
    """Least and most noise a state can have, in units of the action."""
    most_action: float = 3.0
    """Bound of the actions; joints that cannot go as far have less."""
    clone_weight: float = 0.0
    """Weight of staying with the actions in memory, beside the critics' opinion made
    to be one on average (Fujimoto & Gu 2021, arXiv 2106.06860)."""
    priorities: PriorityCfg | None = field(default=None, metadata=NONE_AS_BEFORE)
    """Which steps are drawn more often; None: all alike."""

    def __post_init__(self) -> None:
        for name in ("memory", "batch", "actor_every", "n_step"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1: {getattr(self, name)}")
        if not 0.0 < self.updates_per_step < math.inf:
            raise ValueError(
                f"updates_per_step must be a number above 0: {self.updates_per_step}"
            )
        if not 0.0 <= self.clone_weight < math.inf:
            raise ValueError(
                f"clone_weight must be a number of at least 0: {self.clone_weight}"
            )
        if not 0.0 <= self.gamma < 1.0:
            raise ValueError(f"gamma must lie in [0, 1), got {self.gamma}")
        if not 0.0 < self.std_bounds[0] <= self.first_std <= self.std_bounds[1]:
            raise ValueError(
                f"first_std {self.first_std} must lie within std_bounds "
                f"{self.std_bounds}, both positive"
            )

    def joint_entropy_at(self, done: float) -> float:
        """What a joint is to keep when a share `done` of the training is over."""
        first, last = self.joint_entropy, self.last_joint_entropy
        down = (done - _HIGH_UNTIL) / (_LOW_FROM - _HIGH_UNTIL)
        return first + min(max(down, 0.0), 1.0) * (last - first)

    def rows(self, envs: int, obs_dim: int) -> int:
        """Rows of a memory of `envs` columns.

        Raises:
            GaitprefError: its file would be larger than is read again, or too short.
        """
        rows = self.memory // envs
        size = rows * envs * step_bytes(obs_dim)
        if size > POLICY_BYTES * 0.9:
            most = int(POLICY_BYTES * 0.9) // step_bytes(obs_dim)
            raise GaitprefError(
                f"a memory of {self.memory:,} steps takes {size / 2**20:,.0f} MB, and "
                f"a training goes on from at most {POLICY_BYTES / 2**20:,.0f} MB: give "
                f"--memory {most} or less"
            )
        if rows <= self.n_step + 1:
            raise GaitprefError(
                f"a memory of {self.memory:,} steps is {rows} for each of {envs} "
                f"environments, too few to learn from: give --memory "
                f"{envs * 100} or more, or fewer --envs"
            )
        return rows


def step_bytes(obs_dim: int) -> int:
    """What a step of `obs_dim` observations takes in memory and file."""
    return 4 * (obs_dim + FEATURE_DIM) + _OTHER_BYTES
