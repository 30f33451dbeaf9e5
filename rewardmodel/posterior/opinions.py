"""Opinions about a single habit: every curve there is, and how probable each is.

Shapes: S shapes, A = G S opinions, G habits, K nodes, C clips.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from rewardmodel.habits import TOLD
from rewardmodel.legs import CONTACTS, SINGLE

from .occupancy import NODES
from .ranges import HABITS

_CENTRES = torch.linspace(0, 1, 9)
_WIDTHS = (0.12, 0.25)
"""Of bumps, on the range of a habit."""
_EDGES = (0.25, 0.5, 0.75)
"""Where on the range a habit starts to matter."""
_PROBABLE = {"line": 0.4, "hinge": 0.2, "bump": 0.4}
_LONE = 0.1
"""How probable an opinion about one leg or one side is, beside one about all."""
_LONE_HABITS = {item.name for item in (*CONTACTS, *SINGLE)}
_TOLD = {
    *TOLD,
    "forward_speed",
    "leftward_speed",
    "yaw_rate",
    *(name for name in HABITS if name.startswith("foot_speed")),
}
"""What a command says: over a stride feet go as fast as the robot."""
_SAID_BY_OTHERS = {"height_sq", "planar_error_sq", "yaw_rate_error_sq"}
"""With curves, a square says what the habit itself does."""
LEAST_DEVIATION = 0.01
"""Of a curve over the clips, below which they do not differ in the habit."""


def _shapes() -> tuple[Tensor, Tensor]:
    """Values [S, K] of every shape at the nodes, and its probability [S]."""
    at = NODES
    lines = [at, -at]
    hinges = [(sign * (at - edge)).clamp_min(0) for sign in (1, -1) for edge in _EDGES]
    bumps = [
        (-0.5 * ((at - centre) / width).square()).exp()
        for width in _WIDTHS
        for centre in _CENTRES
    ]
    kinds = {"line": lines, "hinge": hinges, "bump": bumps}
    probable = [
        _PROBABLE[kind] / len(curves) for kind, curves in kinds.items() for _ in curves
    ]
    return torch.stack([*lines, *hinges, *bumps]), torch.tensor(probable)


SHAPES, SHAPE_PROBABLE = _shapes()
"""[S, K] values at the nodes, and [S] how probable each is."""


@dataclass(frozen=True, eq=False)
class Opinions:
    """Every opinion, in units in which clips of one command differ by 1."""

    unit: Tensor
    """[A] deviation of a curve over clips of one command."""
    covariance: Tensor
    """[A, A] of the curves in that unit, over the same clips."""
    probable: Tensor
    """[A] before any answer; 0 for those the clips do not differ in."""

    @classmethod
    def of(cls, occupied: Tensor, command: Tensor, *, told: bool) -> Opinions:
        """Opinions about clips like `occupied` [C, G, K], whose commands are numbered
        in `command` [C]; `told`: also about doing what the robot is told."""
        worth = worth_of(occupied)
        within = worth - _mean_of_each(worth, command)
        deviation = within.square().mean(dim=1).sqrt()
        unit = deviation.clamp_min(LEAST_DEVIATION)
        within = within / unit[:, None]
        probable = _asked(told) * (deviation >= LEAST_DEVIATION)
        return cls(
            unit=unit,
            covariance=within @ within.mT / worth.shape[1],
            probable=probable / probable.sum(),
        )

    def worth(self, occupied: Tensor) -> Tensor:
        """[A, C] what each opinion thinks of clips `occupied` [C, G, K]."""
        return worth_of(occupied) / self.unit[:, None]


def worth_of(occupied: Tensor) -> Tensor:
    """[A, C] mean of every curve over clips `occupied` [C, G, K]."""
    return torch.einsum("cgk,sk->gsc", occupied, SHAPES).flatten(0, 1)


def _mean_of_each(worth: Tensor, group: Tensor) -> Tensor:
    """[A, C] mean of `worth` [A, C] over the clips of each group [C]."""
    one = torch.nn.functional.one_hot(group).to(worth.dtype)
    return (worth @ one / one.sum(dim=0).clamp_min(1)) @ one.mT


def _asked(told: bool) -> Tensor:
    """[A] relative probability of every opinion."""
    of_habit = torch.ones(len(HABITS))
    for names, times in (
        (_LONE_HABITS, _LONE),
        (_TOLD, float(told)),
        (_SAID_BY_OTHERS, 0.0),
    ):
        of_habit[[name in names for name in HABITS]] = times
    return (of_habit[:, None] * SHAPE_PROBABLE).flatten()


def habit_of(opinion: Tensor) -> Tensor:
    """Index in `HABITS` of opinions."""
    return opinion // len(SHAPES)
