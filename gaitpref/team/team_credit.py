"""Who earned what a team got, over episodes, and whether one is lazy.

Shapes: S episodes, T steps, R = 2 robots, F + V columns of a row.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from data.features import column
from rewardmodel.team.stood_still import StandingCfg
from rewardmodel.team.team_reward import TeamReward

_STILL = 0.25
"""Share of the speed that is asked for, below which a robot counts as standing."""
_SURE = 2.0
"""Standard errors by which one robot must earn less to be named."""
_LAZY = 0.1
"""Share of the time by which one stands more than the other that is lazy."""
_LEAST = 0.05
"""Reward per second, in deviations of what was judged, that matters at all."""


@dataclass(frozen=True, eq=False)
class Credit:
    """What both robots earned in one episode, per second."""

    share: tuple[float, float]
    """What each is paid; they add up to what the team is worth."""
    own: tuple[float, float]
    """That without the pair's part."""
    worth: tuple[float, float]
    """What the team would lose had it stood still."""
    still: tuple[float, float]
    """Share of the steps in which each stands though it is told to go."""

    @property
    def whole(self) -> float:
        """What the team is worth."""
        return sum(self.share)


def credit_of(
    model: TeamReward, rows: Tensor, standing: StandingCfg, *, control_dt_s: float
) -> Credit:
    """The credit of an episode with rows [T, R, F + V]."""
    shares = model.shares(rows)
    starts = torch.zeros(len(rows), 1, dtype=torch.bool)
    starts[0] = True
    worth = model.difference(rows[:, None], starts, standing, control_dt_s=control_dt_s)
    return Credit(
        share=_both(shares.of_each.mean(dim=0)),
        own=_both(shares.own.mean(dim=0)),
        worth=_both(worth[:, 0].mean(dim=0)),
        still=standing_share(rows),
    )


def standing_share(rows: Tensor) -> tuple[float, float]:
    """Share of the steps of rows [T, R, F + V] in which each robot stands though it is
    told to go."""
    moved = rows[..., column("base_lin_vel_b")][..., :2]
    speed = torch.linalg.vector_norm(moved, dim=-1)
    told = torch.linalg.vector_norm(rows[..., column("command")][..., :2], dim=-1)
    return _both(((speed < _STILL * told) & (told > 0)).float().mean(dim=0))


def _both(values: Tensor) -> tuple[float, float]:
    first, second = values.tolist()
    return first, second


@dataclass(frozen=True)
class Verdict:
    """Whether one robot earns less than the other."""

    behind: int | None
    """The robot that does, 1 or 2; None where nobody can tell."""
    less: float
    """By how much, reward per second, and ..."""
    error: float
    """... its standard error over episodes."""
    still: tuple[float, float]
    """Share of the time in which each stands."""

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        first, second = (f"{share:.0%}" for share in self.still)
        if self.behind is None:
            more = 1 if self.still[0] > self.still[1] else 2
            lazy = (
                f": robot {more} is lazy, and no answer tells what that costs"
                if abs(self.still[0] - self.still[1]) > _LAZY
                else ""
            )
            return (
                f"both robots earn alike: the difference is {self.less:.2f} +- "
                f"{self.error:.2f} a second; they stand still {first} and {second} of "
                f"the time{lazy}"
            )
        own, other = self.still[self.behind - 1], self.still[2 - self.behind]
        lazy = "it is lazy" if own > other + _LAZY else "not by standing still"
        return (
            f"robot {self.behind} earns {self.less:.2f} +- {self.error:.2f} a second "
            f"less than the other: {lazy}; it stands still {own:.0%} of the time, the "
            f"other {other:.0%}"
        )


def verdict_of(credits: Sequence[Credit]) -> Verdict:
    """The verdict over one episode or more."""
    apart = np.array([each.share[0] - each.share[1] for each in credits])
    still = np.mean([each.still for each in credits], axis=0)
    mean = float(apart.mean())
    error = math.inf
    if len(apart) > 1:
        error = float(apart.std(ddof=1) / math.sqrt(len(apart)))
    behind = None
    if abs(mean) > max(_SURE * error, _LEAST):
        behind = 2 if mean > 0 else 1
    return Verdict(behind, abs(mean), error, (float(still[0]), float(still[1])))


def mean_credit(credits: Iterable[Credit]) -> Credit:
    """The mean over episodes."""
    kept = list(credits)

    def mean(name: str) -> tuple[float, float]:
        first, second = np.mean([getattr(each, name) for each in kept], axis=0)
        return float(first), float(second)

    return Credit(*(mean(name) for name in ("share", "own", "worth", "still")))
