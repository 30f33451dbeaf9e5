"""Settings of a training with actors, and what goes wrong with them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from data.errors import GaitprefError

from .vtrace import VTraceCfg

Update = Literal["sync", "vtrace", "gradients"]


class ActorsError(GaitprefError):
    """Actors cannot be had, or do not do."""


@dataclass(frozen=True, kw_only=True)
class ActorsCfg:
    """Who collects, and how what they collect is learned from."""

    actors: int
    """Processes that collect, each on a core of its own."""
    update: Update = "vtrace"
    """`sync`: actors wait for the weights of the update before, as in PPO; `vtrace`:
    they go on meanwhile, and what they collect with older weights is corrected;
    `gradients`: they send gradients, each taken as it comes (A3C)."""
    address: str | None = None
    """Of a running Ray, HOST:PORT or `auto`; None starts one on this machine."""
    cores: int | None = None
    """Cores a Ray that is started here may use; None: those there are."""
    most_lag: int = 2
    """Updates since the weights of a rollout; one that is older is dropped. A
    gradient's are counted in gradients, of which each actor adds one."""
    correction: VTraceCfg = field(default_factory=VTraceCfg)
    """How far older rollouts are corrected."""

    def __post_init__(self) -> None:
        if self.actors < 1 or self.most_lag < 0:
            raise ValueError(
                f"actors must be at least 1 and most_lag at least 0, got "
                f"{self.actors} and {self.most_lag}"
            )

    def share_of(self, num_envs: int) -> int:
        """Environments of each actor.

        Raises:
            ActorsError: they cannot be shared evenly.
        """
        if num_envs % self.actors:
            more = (num_envs // self.actors + 1) * self.actors
            raise ActorsError(
                f"{num_envs} environments cannot be shared evenly by {self.actors} "
                f"actors: give --envs {more}, or a number of --actors that divides them"
            )
        return num_envs // self.actors
