"""Whether raters look: exact tests of what their answers have in common.

Pure functions of answers. A test says something of a rater who looks less than once in
a thousand times; told of somebody, it is worth a word with them and proves nothing.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from .answer_records import Answer

RARE = 0.001
"""Probability, for a rater who looks, below which answers are told to look odd."""
_GUESSING = 0.05
"""Probability, for one who guesses, of as many hits, below which these are more."""
_SHUFFLED = 0.25
"""Least share of the preferences with either clip on the left, of sides drawn by lot:
what others recorded may always name one clip first."""


@dataclass(frozen=True)
class Sides:
    """Which side of the screen a rater prefers."""

    rater_id: str
    left: int
    """Preferences for the clip on the left."""
    right: int
    """Preferences for the other."""
    shuffled: bool
    """Whether either clip of the pairs was on the left in turn."""

    @property
    def preferences(self) -> int:
        """All of them."""
        return self.left + self.right

    @property
    def chance(self) -> float:
        """Probability that sides drawn by lot come out as uneven (exact, both ends)."""
        fewer = min(self.left, self.right)
        return min(1.0, 2.0 * at_most(fewer, self.preferences, 0.5))

    @property
    def one_sided(self) -> bool:
        """Whether the side decides, and not the gait."""
        return self.shuffled and self.chance < RARE

    def __str__(self) -> str:
        side = "left" if self.left > self.right else "right"
        times = max(self.left, self.right)
        return (
            f"{self.rater_id} preferred the clip on the {side} in {times} of "
            f"{self.preferences} answers, though sides are drawn by lot: of raters who "
            f"look at the gait, less than one in {round(1 / RARE)} does"
        )


def sides_of(answers: Iterable[Answer]) -> tuple[Sides, ...]:
    """The sides of each rater who prefers anything, in the order of their names."""
    preferred: Counter[tuple[str, bool]] = Counter()
    shown: Counter[tuple[str, str]] = Counter()
    for answer in answers:
        if (left := prefers_left(answer)) is not None:
            preferred[answer.rater_id, left] += 1
            shown[answer.rater_id, answer.shown_left] += 1
    found = []
    for name in sorted({name for name, _ in preferred}):
        left, right = preferred[name, True], preferred[name, False]
        rarer = min(shown[name, "a"], shown[name, "b"])
        found.append(Sides(name, left, right, rarer >= _SHUFFLED * (left + right)))
    return tuple(found)


def prefers_left(answer: Answer) -> bool | None:
    """Whether the clip shown left is preferred; None where neither is."""
    if answer.target is None or answer.target == 0.5:
        return None
    return ("a" if answer.target > 0.5 else "b") == answer.shown_left


def guesses(hits: int, of: int, expected: float) -> bool:
    """Whether `hits` of so many fit one who guesses, and hardly one who looks.

    Args:
        hits: Answers that were as they should be.
        of: Answers that could be checked.
        expected: Share of hits of a rater who looks, as low as it may be.
    """
    hardly = at_most(hits, of, expected) < RARE
    return hardly and at_most(of - hits, of, 0.5) > _GUESSING


def at_most(hits: int, of: int, share: float) -> float:
    """Probability of at most `hits` of `of`, each with probability `share`."""
    # Logarithms: of thousands of answers, the numbers themselves are too large.
    ways = (
        math.lgamma(of + 1)
        - math.lgamma(k + 1)
        - math.lgamma(of - k + 1)
        + k * math.log(share)
        + (of - k) * math.log(1 - share)
        for k in range(hits + 1)
    )
    return min(1.0, sum(map(math.exp, ways)))
