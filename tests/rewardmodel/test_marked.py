"""Moments that people marked weigh what a reward sees there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from data.answers.answer_records import Answer, Pair
from data.episodes.clips import Clip
from rewardmodel.explain.attribution import Explanation
from rewardmodel.explain.marked import decided_there, marked_weights, moments_of

DT_S = 0.02


def stumbling() -> Explanation:
    """A second of motion in which the trunk is disliked for 0.1 s from 0.4 s on."""
    shares = np.zeros((50, 2))
    shares[:, 0] = 0.3
    shares[20:25, 1] = -1.0
    return Explanation(
        reward=shares.sum(axis=1),
        spread=np.zeros(50),
        groups=("feet", "trunk"),
        shares=shares,
        descriptors=shares,
        names=("a", "b"),
        average=0.0,
        method="exact",
    )


def test_a_mark_names_what_is_seen_there() -> None:
    """Steps within 0.05 s of it have 0.3 of a bell of 0.12 s deviation: a trunk that is
    disliked there alone, by -1, comes out at -0.32 less the mean of -0.1."""
    found = decided_there(stumbling(), DT_S, [0.45])
    assert list(found) == ["trunk", "feet"]
    assert found["trunk"] == pytest.approx(-0.32 + 0.1, abs=0.01)
    assert found["feet"] == pytest.approx(0.0, abs=1e-9)
    elsewhere = decided_there(stumbling(), DT_S, [0.95])
    assert elsewhere["trunk"] == pytest.approx(0.1, abs=1e-3)
    assert decided_there(stumbling(), DT_S, []) == {}


def test_weights_sum_to_one_and_two_marks_share_them() -> None:
    weights = marked_weights(50, DT_S, [0.2, 0.8])
    assert weights.sum() == pytest.approx(1.0)
    assert weights[:25].sum() == pytest.approx(0.5)
    assert weights.argmax() in (9, 10, 39, 40)
    # Far beyond the clip's end there is nothing to weigh.
    assert not marked_weights(50, DT_S, [100.0]).any()


def answer(client: dict[str, Any]) -> Answer:
    return Answer(
        answer_id="1",
        pair_id="2",
        rater_id="ann",
        choice="a",
        shown_left="a",
        client=client,
        created_utc="2030-01-31T12:00:00Z",
    )


@pytest.mark.parametrize(
    ("marked", "found"),
    [
        ([0.5, 1], (0.5, 1.0)),
        ([], ()),
        ("0.5", ()),
        ({"a": 1}, ()),
        ([-1, True, "x", None, 1e9, 0.25], (0.25,)),
        ([0.1] * 100, (0.1,) * 8),
    ],
)
def test_whatever_a_stranger_wrote_is_no_error(
    marked: Any, found: tuple[float, ...]
) -> None:
    assert answer({"here_s": marked}).here_s == found
    assert answer({}).here_s == ()


def test_both_clips_of_a_pair_are_marked() -> None:
    a, b, c = (Clip(sign * 64, 0, 50) for sign in "abc")
    pair = Pair.make(a, b, strategy="u", round=0)
    rows = [(pair, answer({"here_s": [0.7]})), (pair, answer({"here_s": [0.2]}))]
    assert moments_of(rows, a) == moments_of(rows, b) == [0.2, 0.7]
    assert moments_of(rows, c) == []
