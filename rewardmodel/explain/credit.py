"""What of an answered pair moved the reward: which moment, habit, choice, robot.

The lead of a pair, what its left clip is paid more than its right one, is shared out
several times over: each row of shares adds up to the whole.

Shapes: K steps of a clip, G groups of habits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rewardmodel.answers.clip_batch import ClipBatch
from rewardmodel.models.model import RewardModel

from .attribution import Explanation, Method, explain

FALL = "falling"
TOGETHER = "several at once"
"""What no habit alone explains, of a reward that is no sum of habits."""
_EXACT = 1e-3
"""How far a row may be from the whole, as a share of its parts: rewards are float32."""

Labels = tuple[Sequence[str], Sequence[str]]
"""What each step [K] of the left and of the right clip belongs to."""


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


def credit(
    model: RewardModel,
    left: ClipBatch,
    right: ClipBatch,
    *,
    method: Method = "auto",
    labels: Mapping[str, Labels] | None = None,
) -> Credit:
    """Share out the lead of a pair of clips, each a batch of one.

    Args:
        model: The reward.
        left: Shown on the left.
        right: Shown on the right.
        method: How a step is shared among habits, as of `explain`.
        labels: More rows: by the name of a row, what each step belongs to, such as the
            gait that ran.

    Raises:
        RewardError: the model has no such shares.
    """
    seen = [explain(model, clip, method=method) for clip in (left, right)]
    counts = [clip.scored[0].numpy() for clip in (left, right)]
    ours, theirs = (
        _moments(shown, scored) for shown, scored in zip(seen, counts, strict=True)
    )
    moments = ours, -theirs
    price = model.provenance.cfg.fall_logit / float(model.reward_std)
    falls = price * float(right.fell[0].float() - left.fell[0].float())
    walked = float(moments[0].sum() + moments[1].sum())
    rows = {"habit": _by_habit(seen, counts, walked)}
    for name, of_steps in (labels or {}).items():
        rows[name] = _by_label(moments, of_steps)
    for row in rows.values():
        if falls:
            row[FALL] = falls
    return Credit(
        lead=walked + falls,
        moments=moments,
        falls=falls,
        rows={name: _largest_first(row) for name, row in rows.items()},
    )


def _moments(shown: Explanation, scored: np.ndarray) -> np.ndarray:
    """[K] what each step adds to the mean reward of its clip beyond an average step."""
    return (shown.reward - shown.average) * scored / max(1, int(scored.sum()))


def _by_habit(
    seen: Sequence[Explanation], counts: Sequence[np.ndarray], walked: float
) -> dict[str, float]:
    left, right = (
        shown.shares[scored].mean(axis=0) if scored.any() else shown.shares[:1] * 0.0
        for shown, scored in zip(seen, counts, strict=True)
    )
    shares = (left - right).reshape(-1)
    row = {name: float(v) for name, v in zip(seen[0].groups, shares, strict=True)}
    rest = walked - math.fsum(row.values())
    if abs(rest) > _EXACT * (1.0 + abs(walked)):
        row[TOGETHER] = rest
    return row


def _by_label(
    moments: tuple[np.ndarray, np.ndarray], labels: Labels
) -> dict[str, float]:
    row: dict[str, float] = {}
    for values, names in zip(moments, labels, strict=True):
        for value, name in zip(values, names, strict=True):
            row[name] = row.get(name, 0.0) + float(value)
    return row


def _largest_first(row: Mapping[str, float]) -> dict[str, float]:
    return dict(sorted(row.items(), key=lambda item: -abs(item[1])))
