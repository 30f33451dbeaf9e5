"""SMDP Q-learning of which gait to run, and with it of where a gait ends.

Shapes: B transitions of a minibatch, O gaits.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from .choice_collect import FIELDS, Transitions
from .choosing import ChoosingCfg
from .gaits_model import Chooser
from .smdp import targets, termination_loss, upon_arrival


@dataclass(frozen=True, kw_only=True)
class LearnerCfg:
    """How values of gaits are learned."""

    gamma: float = 0.996
    """Discount of one control step: 5 s of 20 ms weigh one third."""
    learning_rate: float = 1e-3
    batch: int = 256
    """Transitions of an update."""
    updates: int = 8
    """After each look of all environments."""
    follow: float = 0.02
    """Share by which the values behind targets follow those that are learned."""
    memory: int = 60_000
    """Transitions that are kept; the oldest go first."""
    explored: tuple[float, float] = (0.5, 0.05)
    """Share of choices at random, at the beginning and from half of the training on."""

    def __post_init__(self) -> None:
        if not 0.0 < self.gamma < 1.0:
            raise ValueError(f"gamma must lie in (0, 1), got {self.gamma}")

    def explored_at(self, share: float) -> float:
        """Share of choices at random where `share` of the training is done."""
        first, last = self.explored
        return first + (last - first) * min(1.0, 2 * share)


@dataclass
class Learner:
    """Learns the chooser of a policy from transitions."""

    chooser: Chooser
    choosing: ChoosingCfg
    cfg: LearnerCfg
    rng: torch.Generator
    target: Chooser = field(init=False)
    optimizer: torch.optim.Optimizer = field(init=False)
    memory: Transitions | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self.chooser.requires_grad_(requires_grad=True)
        self.target = deepcopy(self.chooser).requires_grad_(requires_grad=False)
        self.optimizer = torch.optim.Adam(
            self.chooser.parameters(), lr=self.cfg.learning_rate
        )

    def take(self, new: Transitions) -> None:
        """Remember transitions."""
        if not len(new):
            return
        kept = new if self.memory is None else Transitions.joined([self.memory, new])
        first = max(0, len(kept) - self.cfg.memory)
        self.memory = kept.rows(torch.arange(first, len(kept)))

    def learn(self) -> float:
        """Update as often as the settings say; gives the last error of the values."""
        error = torch.zeros(())
        for _ in range(self.cfg.updates if self.memory is not None else 0):
            error = self._update()
        return float(error)

    def _update(self) -> Tensor:
        assert self.memory is not None
        which = torch.randint(len(self.memory), (self.cfg.batch,), generator=self.rng)
        batch = self.memory.rows(which)
        q, _ = self.chooser(batch.seen)
        own = q.gather(1, batch.gait[:, None])[:, 0]
        wanted, ends_loss = self._wanted(batch)
        error = torch.nn.functional.smooth_l1_loss(own, wanted)
        self.optimizer.zero_grad()
        (error + ends_loss).backward()
        torch.nn.utils.clip_grad_norm_(self.chooser.parameters(), 10.0)
        self.optimizer.step()
        with torch.no_grad():
            for slow, fast in zip(
                self.target.parameters(), self.chooser.parameters(), strict=True
            ):
                slow.lerp_(fast, self.cfg.follow)
        return error.detach()

    def _wanted(self, batch: Transitions) -> tuple[Tensor, Tensor]:
        """Targets [B] of values, and the loss of learned ends."""
        cost = self.choosing.change_cost
        q_after, _ = self.target(batch.after)
        nothing = torch.zeros(())
        if self.choosing.termination == "learned":
            _, ends = self.chooser(batch.after)
            ends = ends.gather(1, batch.gait[:, None])[:, 0]
            loss = termination_loss(
                ends[~batch.over],
                q_after[~batch.over],
                batch.gait[~batch.over],
                cost=cost,
            )
        else:
            ends, loss = torch.ones(len(batch)), nothing
        arrived = upon_arrival(q_after, batch.gait, ends.detach(), cost)
        return (
            targets(batch.paid, batch.steps, arrived, batch.over, gamma=self.cfg.gamma),
            loss,
        )

    def snapshot(self) -> dict[str, Any]:
        """All that learning goes on from."""
        memory = self.memory
        return {
            "chooser": deepcopy(self.chooser.state_dict()),
            "target": deepcopy(self.target.state_dict()),
            "optimizer": deepcopy(self.optimizer.state_dict()),
            "rng": self.rng.get_state(),
            "memory": {}
            if memory is None
            else {name: getattr(memory, name).clone() for name in FIELDS},
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Go on from a `snapshot`."""
        self.chooser.load_state_dict(saved["chooser"])
        self.target.load_state_dict(saved["target"])
        self.optimizer.load_state_dict(saved["optimizer"])
        self.rng.set_state(saved["rng"])
        self.memory = Transitions(**saved["memory"]) if saved["memory"] else None
