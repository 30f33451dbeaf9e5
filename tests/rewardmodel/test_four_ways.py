"""A clip's reward by moment, habit, choice and robot."""

from __future__ import annotations

import numpy as np
import pytest

from rewardmodel.explain.attribution import Explanation
from rewardmodel.explain.four_ways import AVERAGE, REST, four_ways


def explanation() -> Explanation:
    """Thirty steps with two groups of habits and two robots."""
    rng = np.random.default_rng(0)
    robots, shares = rng.normal(size=(30, 2)), rng.normal(size=(30, 2))
    return Explanation(
        reward=robots.sum(axis=1),
        spread=np.ones(30),
        groups=("feet", "effort"),
        shares=shares,
        descriptors=np.zeros((30, 2)),
        names=("slip", "power"),
        average=0.25,
        method="occlusion",
        robots=robots,
    )


def test_every_way_adds_up_to_the_whole() -> None:
    """Also where habits alone explain a part, and a name is chosen twice."""
    shown = explanation()
    runs = [("walk", 0, 10), ("crouch", 10, 24), ("walk", 24, 30)]
    parts = four_ways(shown, control_dt_s=0.02, runs=runs)
    assert list(parts.ways) == ["moment", "habit", "choice", "robot"]
    for way, shares in parts.ways.items():
        assert sum(shares.values()) == pytest.approx(shown.reward.mean()), way
    assert list(parts.moments) == ["0.20 s", "0.40 s", "0.60 s"]
    assert list(parts.choices) == ["walk", "crouch"]
    assert parts.habits[AVERAGE] == 0.25
    assert REST in parts.habits


def test_rows_that_are_not_there_are_left_out() -> None:
    parts = four_ways(
        Explanation(**{**vars(explanation()), "robots": None}), control_dt_s=0.02
    )
    assert list(parts.ways) == ["moment", "habit"]
    with pytest.raises(ValueError, match="do not cover 30 steps"):
        four_ways(explanation(), control_dt_s=0.02, runs=[("walk", 0, 29)])
