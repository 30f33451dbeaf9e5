"""Means over seeds, with intervals for few of them.

A bootstrap of three values cannot leave the range they span; Student's t, which takes
what seeds give for normal, is about right from two on.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self


@dataclass(frozen=True)
class SeedMean:
    """The mean of one figure over seeds."""

    mean: float
    half_width: float | None
    """Of the 95 % t-interval of the mean; None where one value says nothing of it."""
    count: int

    @classmethod
    def of(cls, values: Sequence[float]) -> Self:
        """The mean of at least one value.

        Raises:
            ValueError: there is none.
        """
        count = len(values)
        if not count:
            raise ValueError("a mean needs a value")
        mean = statistics.fmean(values)
        if count == 1:
            return cls(mean, None, 1)
        error = statistics.stdev(values) / math.sqrt(count)
        return cls(mean, t_quantile(count - 1) * error, count)

    def __str__(self) -> str:
        width = "" if self.half_width is None else f" ± {self.half_width:.2f}"
        return f"{self.mean:.2f}{width}"


def t_quantile(freedom: int, level: float = 0.95) -> float:
    """What a Student-t variable of so many degrees of freedom stays below, in absolute
    value, with probability `level`."""
    low, high = 0.0, 1.0
    while t_within(high, freedom) < level:
        high *= 2.0
    for _ in range(60):
        middle = (low + high) / 2.0
        if t_within(middle, freedom) < level:
            low = middle
        else:
            high = middle
    return high


def t_within(t: float, freedom: int) -> float:
    """Probability that a Student-t variable lies in [-t, t]: Abramowitz and Stegun
    (1964), equations 26.7.3 and 26.7.4."""
    angle = math.atan2(t, math.sqrt(freedom))
    sine, cosine = math.sin(angle), math.cos(angle)
    odd = freedom % 2
    term = total = cosine if odd else 1.0
    for k in range(2 + odd, freedom, 2):
        term *= cosine**2 * (k - 1) / k
        total += term
    if not odd:
        return sine * total
    if freedom == 1:
        total = 0.0
    return (angle + sine * total) * 2.0 / math.pi
