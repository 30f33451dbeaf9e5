"""What a reward sees at the moments that people marked.

A mark says: here it was decided. So what habits add to the reward is weighted by how
near a step is to a mark, instead of all steps alike.

Shapes: K steps, G groups.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from data.answers.answer_records import Answer, Pair
from data.episodes.clips import Clip

from .attribution import Explanation

_NEAR_S = 0.12
"""Deviation of the weight around a mark: people press a little late or early."""


def moments_of(answered: Iterable[tuple[Pair, Answer]], clip: Clip) -> list[float]:
    """Moments of a clip that answers marked, in s since its beginning.

    Args:
        answered: Current answers.
        clip: As it was shown.
    """
    found: list[float] = []
    for pair, answer in answered:
        if clip in (pair.a, pair.b):
            found += answer.here_s
    return sorted(found)


def marked_weights(steps: int, dt_s: float, here_s: Sequence[float]) -> np.ndarray:
    """[K] how near each step is to a mark; they sum to 1, or are 0 without a mark."""
    time_s = (np.arange(steps) + 0.5) * dt_s
    apart = (time_s[:, None] - np.asarray(here_s, float)[None, :]) / _NEAR_S
    weights = np.exp(-0.5 * apart**2).sum(axis=1)
    total = weights.sum()
    return weights / total if total > 0 else np.zeros(steps)


def decided_there(
    shown: Explanation, dt_s: float, here_s: Sequence[float]
) -> dict[str, float]:
    """What each group of habits adds to the reward at the marks more than in the mean
    of all steps, what is liked or disliked most there first; nothing without a mark."""
    weights = marked_weights(len(shown.shares), dt_s, here_s)
    if not weights.any() or not np.isfinite(shown.shares).all():
        return {}
    more = weights @ shown.shares - shown.shares.mean(axis=0)
    order = np.argsort(-np.abs(more))
    return {shown.groups[index]: float(more[index]) for index in order}
