"""Opinions about a single habit: every curve there is, and how probable each is.

Shapes: S shapes, A = G S opinions, G habits, K nodes, C clips.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import torch
from torch import Tensor

from data.answers.answer_records import ASPECTS

from .occupancy import NODES
from .ranges import HABITS, TABLE

_CENTRES = torch.linspace(0, 1, 9)
_WIDTHS = (0.12, 0.25)
"""Widths of bumps, on the range of a habit."""
_EDGES = (0.25, 0.5, 0.75)
"""Where on the range a habit starts to matter."""
_PROBABLE = {"line": 0.4, "hinge": 0.2, "bump": 0.4}
_TOLD = ("planar error", "yaw rate error", "speed", "foot speed")
"""Concepts of what a command says: over a stride feet go as fast as the robot."""
LEAST_DEVIATION = 0.05
"""Deviation of a curve over the clips below which they do not differ in the habit."""


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
_IS_BUMP = torch.arange(len(SHAPES)) >= len(SHAPES) - len(_WIDTHS) * len(_CENTRES)


ASPECT_OF_OPINION = torch.tensor(
    [[habit.aspect == aspect for aspect in ASPECTS] for habit in TABLE]
).repeat_interleave(len(SHAPES), dim=0)
"""[A, P] bool, of P aspects."""


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
        if not probable.any():
            # Clips that differ in nothing tell of nothing: any opinion does as well.
            probable = _asked(told)
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
    concepts = [
        habit.concept if told or habit.concept not in _TOLD else None for habit in TABLE
    ]
    habits = Counter(concept for concept in concepts if concept is not None)
    of_habit = torch.tensor([1 / habits[c] if c is not None else 0.0 for c in concepts])
    # A wish that a foot be neither high nor low is none: no bumps of what swings.
    swings = torch.tensor([habit.swings for habit in TABLE])
    shapes = SHAPE_PROBABLE.expand(len(HABITS), -1)
    shapes = shapes.masked_fill(swings[:, None] & _IS_BUMP, 0.0)
    return (of_habit[:, None] * shapes / shapes.sum(dim=1, keepdim=True)).flatten()


def habit_of(opinion: Tensor) -> Tensor:
    """Index in `HABITS` of opinions."""
    return opinion // len(SHAPES)
