"""What of an answered pair moved the reward: which moment, habit, choice, robot.

The lead of a pair, what its left clip is paid more than its right one, is shared out
several times over: each row of shares adds up to the whole.

Shapes: K steps of a clip, G groups of habits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rewardmodel.answers.clip_batch import ClipBatch
from rewardmodel.models.model import RewardModel

from .attribution import Explanation, Method, explain
from .four_ways import AVERAGE, REST, Run, four_ways

FALL = "falling"
_EXACT = 1e-3
"""How far a row may be from the whole, as a share of its parts: rewards are float32."""
_ALIKE = (AVERAGE, REST)
"""Shares that mostly are no more of one clip than of the other."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Credit:
    """The lead of a pair, shared out.

    Raises:
        ValueError: a row does not add up to the lead.
    """

    lead: float
    """What the left clip is paid more, in units of the reward, the price of falls
    included."""
    moments: tuple[np.ndarray, np.ndarray]
    """[K] of the left and of the right clip: what each step adds to the lead."""
    falls: float
    """What falls add to it."""
    rows: Mapping[str, Mapping[str, float]]
    """Shares by what a row is about, `habit` and whatever else there is; the largest
    first."""

    def __post_init__(self) -> None:
        of_moments = [float(part.sum()) for part in self.moments]
        whole = {"moment": [*of_moments, self.falls]}
        whole |= {name: list(row.values()) for name, row in self.rows.items()}
        for name, shares in whole.items():
            off = math.fsum(shares) - self.lead
            if not abs(off) <= _EXACT * (1.0 + sum(map(abs, shares))):
                raise ValueError(
                    f"shares by {name} add up to {math.fsum(shares):.4f}, the lead is "
                    f"{self.lead:.4f}"
                )


@dataclass(frozen=True, kw_only=True, eq=False)
class Side:
    """One clip of a pair, as a reward sees it."""

    shown: Explanation
    """Of all its steps."""
    scored: np.ndarray
    """[K] which of them count: one that falls does not."""
    fell: bool
    runs: Sequence[Run] = ()
    """What was chosen when, where there was a choice."""

    @classmethod
    def of(
        cls,
        model: RewardModel,
        clip: ClipBatch,
        *,
        method: Method = "auto",
        runs: Sequence[Run] = (),
    ) -> Side:
        """The side of a clip, a batch of one.

        Raises:
            RewardError: the model has no shares of that kind.
        """
        shown = explain(model, clip, method=method)
        scored, fell = clip.scored[0].numpy(), bool(clip.fell[0])
        return cls(shown=shown, scored=scored, fell=fell, runs=runs)

    @property
    def moments(self) -> np.ndarray:
        """[K] what each step adds to the mean reward beyond an average step."""
        above = (self.shown.reward - self.shown.average) * self.scored
        return above / max(1, int(self.scored.sum()))

    @property
    def mean(self) -> float:
        """Mean reward of the steps that count; that of an average one without any."""
        if not self.scored.any():
            return self.shown.average
        return float(self.shown.reward[self.scored].astype(float).mean())

    def ways(self, control_dt_s: float, level: float) -> dict[str, dict[str, float]]:
        """Shares of the mean reward of the steps that count, and of what was chosen
        those of what it is beyond `level`."""
        if not self.scored.any():
            return {}
        # The steps that count come first: only a fall follows.
        shown, count = self.shown.part(self.scored), int(self.scored.sum())
        runs = [(name, a, min(b, count)) for name, a, b in self.runs if a < count]
        found = four_ways(shown, control_dt_s=control_dt_s, runs=runs).ways
        if runs:
            beyond = replace(shown, reward=shown.reward.astype(float) - level)
            parted = four_ways(beyond, control_dt_s=control_dt_s, runs=runs)
            found["choice"] = parted.choices
        return found


def credit(
    left: Side, right: Side, *, fall_price: float, control_dt_s: float
) -> Credit:
    """Share out the lead of a pair.

    Args:
        left: Shown on the left.
        right: Shown on the right.
        fall_price: What a fall costs, in units of the reward.
        control_dt_s: Control step.
    """
    moments = left.moments, -right.moments
    falls = fall_price * (float(right.fell) - float(left.fell))
    # What ran for longer has not earned more for that.
    level = (left.mean + right.mean) / 2
    if not (left.scored.any() and right.scored.any()):
        level = left.shown.average
    ours, theirs = (side.ways(control_dt_s, level) for side in (left, right))
    rows = {
        name: _less(ours.get(name, {}), theirs.get(name, {}), falls)
        for name in ("habit", "choice", "robot")
        if name in ours or name in theirs
    }
    lead = float(moments[0].sum() + moments[1].sum()) + falls
    return Credit(lead=lead, moments=moments, falls=falls, rows=rows)


def _less(
    left: Mapping[str, float], right: Mapping[str, float], falls: float
) -> dict[str, float]:
    """Shares of the left clip less those of the right, the largest first."""
    row = {
        name: left.get(name, 0.0) - right.get(name, 0.0) for name in {**left, **right}
    }
    # Both have as much of an average step, unless one has no step that counts.
    row = {n: v for n, v in row.items() if n not in _ALIKE or abs(v) > _EXACT}
    if falls:
        row[FALL] = falls
    return dict(sorted(row.items(), key=lambda item: -abs(item[1])))
