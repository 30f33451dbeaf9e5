"""The reward of a clip parted in four ways: by moment, habit, choice and robot.

Each way adds up to the whole, so that the four can be laid beside one another.

Shapes: K steps, G groups of habits, R robots.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from .attribution import Explanation

Run = tuple[str, int, int]
"""What was chosen, its first step, and the step behind its last."""
MOMENT_S = 0.2
"""Length of a moment."""
AVERAGE, REST = "an average step", "the rest"


@dataclass(frozen=True, eq=False)
class FourWays:
    """Shares of the mean reward of a clip; every way adds up to `whole`."""

    whole: float
    moments: dict[str, float]
    """By when, as `0.2 s`, the end of each moment."""
    habits: dict[str, float]
    """By group, beside what an average step gets and what no group alone explains."""
    choices: dict[str, float]
    """By what ran; empty where nothing was chosen."""
    robots: dict[str, float]
    """By robot; empty where there is one."""

    @property
    def ways(self) -> dict[str, dict[str, float]]:
        """The ways that there are, by name."""
        found = {
            "moment": self.moments,
            "habit": self.habits,
            "choice": self.choices,
            "robot": self.robots,
        }
        return {name: shares for name, shares in found.items() if shares}


def four_ways(
    shown: Explanation, *, control_dt_s: float, runs: Sequence[Run] = ()
) -> FourWays:
    """Part the mean reward of the steps of `shown`.

    Args:
        shown: The steps.
        control_dt_s: Control step.
        runs: What was chosen when, without gaps; nothing where there was no choice.

    Raises:
        ValueError: the runs do not cover the steps.
    """
    reward = shown.reward.astype(float)
    count, whole = len(reward), float(reward.mean())
    if runs and [0, *(stop for _, _, stop in runs)] != [
        *(first for _, first, _ in runs),
        count,
    ]:
        raise ValueError(f"the runs do not cover {count} steps one after the other")
    width = max(1, round(MOMENT_S / control_dt_s))
    moments = {
        f"{min(first + width, count) * control_dt_s:.2f} s": float(
            reward[first : first + width].sum() / count
        )
        for first in range(0, count, width)
    }
    by_group = shown.shares.astype(float).mean(axis=0)
    habits = dict(zip(shown.groups, by_group.tolist(), strict=True))
    habits[AVERAGE] = float(shown.average)
    left = whole - sum(habits.values())
    if abs(left) > 1e-6:
        habits[REST] = left
    choices: dict[str, float] = {}
    for name, first, stop in runs:
        share = float(reward[first:stop].sum() / count)
        choices[name] = choices.get(name, 0.0) + share
    robots: dict[str, float] = {}
    if shown.robots is not None:
        means = shown.robots.astype(float).mean(axis=0)
        robots = {f"robot {n}": float(mean) for n, mean in enumerate(means, start=1)}
    return FourWays(whole, moments, habits, choices, robots)
