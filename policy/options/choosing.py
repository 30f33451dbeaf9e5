"""Which gait runs next: a pure function of what runs, what is ahead and its worth.

Shapes: N environments, O gaits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import torch
from torch import Tensor

from .smdp import change_costs

Termination = Literal["learned", "fixed"]
_LONGEST_S = 600.0
_WANDERS = 0.15
"""Share of the looks at which who wanders changes: after 1.3 s of looks of 0.2 s."""


@dataclass(frozen=True, kw_only=True)
class ChoosingCfg:
    """When a gait may end, and who follows."""

    termination: Termination = "fixed"
    """A gait ends with a probability learned for each state, or after `length_s`."""
    length_s: float = 1.0
    """With `fixed`: how long a gait runs."""
    look_s: float = 0.2
    """Time from one look ahead to the next: a gait may end or be interrupted there."""
    interrupt_margin: float | None = None
    """Interrupt a gait where another is worth more by this, in units of the return;
    None lets it run until it ends."""
    change_cost: float = 0.05
    """What a change of gait costs, in units of the return."""

    def __post_init__(self) -> None:
        for name in ("length_s", "look_s"):
            if not 0 < getattr(self, name) < _LONGEST_S:
                raise ValueError(
                    f"{name} must lie in (0, {_LONGEST_S:g}), got {getattr(self, name)}"
                )
        if not 0.0 <= (self.interrupt_margin or 0.0) < math.inf:
            raise ValueError(
                f"interrupt_margin must be at least 0, got {self.interrupt_margin}"
            )
        if self.termination == "fixed" and self.length_s < self.look_s:
            raise ValueError(
                f"a gait of {self.length_s:g} s ends before the next look at "
                f"{self.look_s:g} s"
            )

    def look_steps(self, control_dt_s: float) -> int:
        """Control steps between two looks."""
        return max(1, round(self.look_s / control_dt_s))

    def length_steps(self, control_dt_s: float) -> int:
        """Control steps of a gait of fixed length, a whole number of looks."""
        looks = max(1, round(self.length_s / self.look_s))
        return looks * self.look_steps(control_dt_s)


@dataclass(frozen=True, eq=False)
class Running:
    """Which gait runs in every environment."""

    gait: Tensor
    """[N] long"""
    steps: Tensor
    """[N] long, control steps since it was chosen"""
    chosen: Tensor
    """[N] it was chosen just now"""

    @staticmethod
    def nothing(num_envs: int) -> Running:
        """Before the first choice."""
        zeros = torch.zeros(num_envs, dtype=torch.long)
        return Running(gait=zeros, steps=zeros, chosen=zeros.bool())


@dataclass(frozen=True, eq=False)
class Draws:
    """Uniform draws in [0, 1) of one choice."""

    ends: Tensor
    """[N] a gait ends where its probability is above; 0.5 for the likelier."""
    explores: Tensor
    """[N] a gait at random where below the share of exploration"""
    gait: Tensor
    """[N] which then"""

    @staticmethod
    def none(rows: Tensor) -> Draws:
        """No chance for `rows` [N, D]: the likelier, and the best."""
        # Made of them: a trace keeps what hangs on their number for what always is.
        half = torch.full_like(rows[:, 0], 0.5)
        return Draws(ends=half, explores=2 * half, gait=half)

    @staticmethod
    def of(rng: torch.Generator, num_envs: int) -> Draws:
        """New ones."""
        return Draws(*torch.rand(3, num_envs, generator=rng))


def looks(running: Running, look_steps: int, begins: Tensor) -> Tensor:
    """[N] where a gait may end now; nowhere in the first step of an episode."""
    return (running.steps % look_steps == 0) & ~begins


def choose(
    running: Running,
    q: Tensor,
    ends: Tensor,
    begins: Tensor,
    cfg: ChoosingCfg,
    *,
    control_dt_s: float,
    draws: Draws,
    explored: float = 0.0,
    wandering: Tensor | None = None,
) -> Running:
    """The gaits of the next control step.

    Args:
        running: Those of the last, with the steps they have run.
        q: Values [N, O] of running each gait from here.
        ends: [N, O] probability that each ends here, if it is learned.
        begins: [N] an episode begins: nothing ran.
        cfg: When a gait may end.
        control_dt_s: Time of a step.
        draws: Chance.
        explored: Share of choices at random.
        wandering: [N] who changes at random, at a share of all looks.
    """
    look = looks(running, cfg.look_steps(control_dt_s), begins)
    own = running.gait[:, None]
    if cfg.termination == "learned":
        over = look & (ends.gather(1, own)[:, 0] > draws.ends)
    else:
        over = look & (running.steps >= cfg.length_steps(control_dt_s))
    cost = torch.where(
        begins[:, None], 0.0, change_costs(running.gait, q.shape[1], cfg.change_cost)
    )
    worth = q - cost
    if cfg.interrupt_margin is not None:
        lead = worth.amax(dim=1) - q.gather(1, own)[:, 0]
        over = over | (look & (lead > cfg.interrupt_margin))
    anyone = draws.explores < explored
    if cfg.termination == "learned":
        # Ends that are learned become rare before it is known what follows them.
        over = over | (look & anyone)
    if wandering is not None:
        anyone = anyone | (wandering & ((draws.explores < _WANDERS) | begins))
        over = over | (look & anyone & wandering)
    chosen = begins | over
    at_random = (draws.gait * q.shape[1]).long()
    best = torch.where(anyone, at_random, worth.argmax(dim=1))
    return Running(
        gait=torch.where(chosen, best, running.gait),
        steps=torch.where(chosen, 0, running.steps),
        chosen=chosen,
    )


def ran(running: Running) -> Running:
    """One control step later."""
    return replace(running, steps=running.steps + 1)
