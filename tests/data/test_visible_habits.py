"""What people see of two clips, and how it is said."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.walks import DT_S, walk
from data.episodes.visible_habits import (
    VISIBLE_HABITS,
    difference_words,
    most_different,
    visible_habits,
)
from data.features import column


def seen(step_hz: float = 2.0, **changed: float) -> np.ndarray:
    """Habits of a trot over two seconds, some features higher by so much."""
    rows = walk(100, seed=0, step_hz=step_hz).features.copy()
    for name, by in changed.items():
        rows[:, column(name)] += by
    return visible_habits(rows, DT_S)


def test_what_differs_is_said_of_the_one_who_does_more() -> None:
    assert difference_words(seen(), seen()) == []
    assert difference_words(seen(), seen(foot_height=0.03)) == [
        "B lifts its feet 3 cm higher."
    ]
    assert difference_words(seen(base_height=0.05), seen()) == [
        "A carries its trunk 5 cm higher."
    ]
    assert difference_words(seen(step_hz=3.0), seen(step_hz=2.0)) == [
        "A takes 1.0 more strides a second."
    ]


def test_a_finer_difference_is_said_where_it_is_asked_for() -> None:
    """A centimetre of foot lift is half of what is noticed."""
    fine = seen(), seen(foot_height=0.01)
    assert difference_words(*fine) == []
    assert difference_words(*fine, least=0.3) == ["B lifts its feet 1 cm higher."]


def test_the_plainest_difference_comes_first() -> None:
    """Six centimetres are three differences that are just noticed, four are two."""
    said = difference_words(seen(), seen(foot_height=0.04, base_height=0.06))
    assert said == ["B carries its trunk 6 cm higher.", "B lifts its feet 4 cm higher."]
    habits = np.stack([seen(), seen(foot_height=0.04, base_height=0.06)])
    assert most_different(habits, np.array([[0, 1], [1, 0], [1, 1]])) == pytest.approx(
        [3.0, 3.0, 0.0]
    )


def test_where_a_clip_is_cut_changes_no_rate_of_steps() -> None:
    rows = walk(140, seed=0, step_hz=2.3).features
    names = [habit.name for habit in VISIBLE_HABITS]
    rates = [
        visible_habits(rows[start : start + 60], DT_S)[names.index("steps")]
        for start in range(0, 80, 7)
    ]
    assert np.ptp(rates) < 0.25


def test_a_foot_that_chatters_takes_no_more_strides() -> None:
    """Neither one that leaves the ground for a step nor one that grazes it."""
    rows = walk(100, seed=0, step_hz=2.0).features
    rough = rows.copy()
    contact = column("foot_contact")
    # Every swing and stance is turned round for a step in its middle.
    legs = rough[:, contact]
    for leg in range(4):
        turns = np.flatnonzero(np.diff(legs[:, leg]))
        for middle in (turns[:-1] + turns[1:]) // 2:
            legs[middle, leg] = 1.0 - legs[middle, leg]
    rough[:, contact] = legs
    said = difference_words(visible_habits(rows, DT_S), visible_habits(rough, DT_S))
    assert [words for words in said if "strides" in words] == []


def test_what_was_not_measured_is_no_difference() -> None:
    """Hardware may know the joints and nothing of the feet."""
    blind = seen(foot_height=np.nan)
    assert difference_words(blind, seen(base_height=0.03)) == [
        "B carries its trunk 3 cm higher."
    ]
    assert np.isfinite(most_different(np.stack([blind, seen()]), np.array([[0, 1]])))


def test_a_fall_is_seen() -> None:
    fallen = visible_habits(walk(100, seed=0, fell=True).features, DT_S)
    assert "A falls." in difference_words(fallen, seen())
