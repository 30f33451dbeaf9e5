"""The way ahead of a robot, and how far it came of what it was asked for."""

import numpy as np
import pytest

from labeling_ui.scene.obedience import AHEAD_S, HIDDEN_M, obeyed, ways

STANDS = np.zeros((2, 2))
AHEAD = np.zeros(2)


def test_the_way_ahead_is_as_long_as_the_speed_says_and_turns_with_the_robot() -> None:
    """0.5 m/s forward, of a robot that heads to the left."""
    headings = np.array([0.0, np.pi / 2])
    positions, wxyzs = ways(STANDS, headings, np.array([[0.5, 0.0, 0.0]]))
    length = positions[:, -1] - positions[:, 0]
    expected = [[0.5 * AHEAD_S, 0.0, 0.0], [0.0, 0.5 * AHEAD_S, 0.0]]
    assert length == pytest.approx(np.array(expected), abs=1e-6)
    assert wxyzs[1, 0] == pytest.approx([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])


def test_a_turn_on_the_spot_is_a_bow_around_it() -> None:
    """All marks are as far away; the last is turned by the yaw of that time."""
    positions, wxyzs = ways(STANDS, AHEAD, np.array([[0.0, 0.0, 1.0]]))
    far = np.linalg.norm(positions[0, :, :2], axis=-1)
    assert far == pytest.approx(far[0])
    angles = 2 * np.arctan2(wxyzs[0, :, 3], wxyzs[0, :, 0])
    assert angles[-1] - angles[0] == pytest.approx(AHEAD_S)


def test_who_is_told_to_stand_has_no_way() -> None:
    positions, _ = ways(STANDS, AHEAD, np.zeros((1, 3)))
    assert (positions == HIDDEN_M).all()


def test_what_was_asked_for_is_measured_along_the_robot() -> None:
    """Sent to the left at 0.2 m/s for a second, it goes half as far, and ahead."""
    ground = np.linspace([0.0, 0.0], [0.3, 0.1], 51)
    asked = np.tile([0.0, 0.2, 0.5], (50, 1))
    found = obeyed(ground, np.zeros(51), asked, 0.02)
    assert found.went_m == pytest.approx(0.1)
    assert found.asked_m == pytest.approx(0.2)
    assert (found.turned_rad, found.asked_rad) == pytest.approx((0.0, 0.5))
