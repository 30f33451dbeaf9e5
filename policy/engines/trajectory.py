"""What an actor sends the learner.

Shapes: T steps of a rollout, N environments of an actor, F feature columns.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np


@dataclass(frozen=True)
class Origin:
    """Which rollout it is, and of which policy."""

    actor: int
    sequence: int
    """Of the rollouts of this actor, over all the processes it has been."""
    version: int
    """Of the weights that acted."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """One rollout of one actor, whose weights did not change meanwhile."""

    origin: Origin
    observations: dict[str, np.ndarray]
    """[T, N, ...] by group, of the states acted in."""
    last_observations: dict[str, np.ndarray]
    """[N, ...] by group, after the last step."""
    actions: np.ndarray
    """[T, N, 12]"""
    log_probs: np.ndarray
    """[T, N] of the actions, by the policy that acted."""
    features: np.ndarray
    """[T, N, F]"""
    starts: np.ndarray
    """[T, N] whether a step began an episode."""
    dones: np.ndarray
    """[T, N] whether it ended one."""
    time_outs: np.ndarray
    """[T, N] 1 where it was not a fall that ended it."""
    valid: np.ndarray
    """[T, N] 0 where a simulation diverged."""
    collect_s: float
    """Time it took to collect."""

    def __post_init__(self) -> None:
        shape = self.log_probs.shape
        for name in ("actions", "features", "starts", "dones", "time_outs", "valid"):
            found = getattr(self, name).shape
            if found[:2] != shape:
                raise ValueError(f"{name} is {found}, log_probs are {shape}")

    @property
    def bytes(self) -> int:
        """Size of its arrays."""
        own = (getattr(self, field.name) for field in fields(self))
        parts = [each for each in own if isinstance(each, np.ndarray)]
        groups = [*self.observations.values(), *self.last_observations.values()]
        return sum(part.nbytes for part in [*parts, *groups])


@dataclass(frozen=True, kw_only=True, eq=False)
class Gradient:
    """What one rollout of one actor says each weight should change by (A3C)."""

    origin: Origin
    actor: list[np.ndarray]
    """Of the loss, for each parameter of the actor's network in order."""
    critic: list[np.ndarray]
    moments: dict[str, tuple[int, np.ndarray, np.ndarray]]
    """How many observations of each network there were, their mean and variance."""
    scalars: dict[str, float]
    """What the rollout was like, by TensorBoard tag."""
    mean_reward: float
    collect_s: float

    @property
    def bytes(self) -> int:
        """Size of its arrays."""
        return sum(part.nbytes for part in [*self.actor, *self.critic])


class Sent(Protocol):
    """Whatever an actor sends."""

    @property
    def origin(self) -> Origin: ...
    @property
    def bytes(self) -> int: ...
    @property
    def collect_s(self) -> float: ...
