"""Gait descriptors and clip means, on rows made by hand."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from data.features import FEATURE_DIM, column
from rewardmodel.answers.clip_batch import ClipBatch, mean_over, pad_clips
from rewardmodel.descriptors.table import DESCRIPTOR_NAMES, DESCRIPTORS, describe


def standing_row() -> Tensor:
    """A robot that stands still, 0.3 m high, though asked to walk at 0.5 m/s."""
    row = torch.zeros(FEATURE_DIM)
    row[column("gravity_b")] = torch.tensor([0.0, 0.0, -1.0])
    row[column("base_height")] = 0.3
    row[column("command")] = torch.tensor([0.5, 0.0, -0.2])
    row[column("foot_contact")] = 1.0
    row[column("joint_torque")] = 2.0
    return row


def described(row: Tensor) -> dict[str, float]:
    return dict(zip(DESCRIPTOR_NAMES, describe(row).tolist(), strict=True))


def changed(**columns: list[float] | float) -> dict[str, float]:
    row = standing_row()
    for name, value in columns.items():
        row[column(name)] = torch.as_tensor(value)
    return described(row)


def test_a_standing_robot_by_hand() -> None:
    """Everything that is not zero: errors, height, 12 * 2^2 of torque, four feet."""
    expected = dict.fromkeys(DESCRIPTOR_NAMES, 0.0) | {
        "planar_error": 0.5,
        "planar_error_sq": 0.25,
        "yaw_rate_error": 0.2,
        "yaw_rate_error_sq": 0.04,
        "height": 0.3,
        "height_sq": 0.09,
        "torque_sq": 48.0,
        "contacts": 4.0,
    }
    assert described(standing_row()) == pytest.approx(expected)


def test_power_counts_braking() -> None:
    """Eleven joints at 1 rad/s with 2 N m, one turning against its torque."""
    assert changed(joint_vel=[-1.0] + [1.0] * 11)["power"] == pytest.approx(24.0)


@pytest.mark.parametrize(
    ("gravity_b", "tilt_sq"),
    [
        ([0.0, 0.0, -1.0], 0.0),
        ([0.6, 0.0, -0.8], 0.36),
        ([0.0, 1.0, 0.0], 1.0),
        ([0.6, 0.0, 0.8], 1.64),
        ([0.0, 0.0, 1.0], 2.0),
    ],
)
def test_the_tilt_grows_until_a_robot_lies_on_its_back(
    gravity_b: list[float], tilt_sq: float
) -> None:
    assert changed(gravity_b=gravity_b)["tilt_sq"] == pytest.approx(tilt_sq)


def test_slip_counts_only_feet_on_the_ground() -> None:
    found = changed(foot_contact=[1, 0, 0, 1], foot_speed=[0.5, 9.0, 9.0, 1.0])
    assert found["slip"] == pytest.approx(1.25)


def test_lift_offs_count_steps_and_not_how_long_they_last() -> None:
    """One swing of 0.3 s or two of 0.15 s: as long in the air, twice as many."""
    short, long = (torch.arange(1, n + 1) * 0.02 for n in (8, 16))

    def mean_of(*swings: Tensor) -> float:
        rows = standing_row().repeat(40, 1)
        air_s = torch.cat((*swings, torch.zeros(40)))[:40]
        rows[:, column("foot_air_time").start] = air_s
        return float(describe(rows)[:, DESCRIPTOR_NAMES.index("lift_offs")].mean())

    twice = mean_of(short, torch.zeros(1), short) / mean_of(long)
    assert twice == pytest.approx(2.0, rel=0.05)


def test_a_clip_and_a_live_batch_are_described_alike() -> None:
    rows = torch.randn(24, 8, FEATURE_DIM, generator=torch.Generator().manual_seed(0))
    assert torch.equal(describe(rows)[:, 3], describe(rows[:, 3]))
    assert describe(rows).shape == (24, 8, len(DESCRIPTORS))
    assert describe(rows).dtype == torch.float32


@given(st.lists(st.floats(width=32, allow_nan=False, allow_infinity=False), min_size=1))
def test_every_finite_row_has_finite_descriptors(values: list[float]) -> None:
    row = torch.from_numpy(np.resize(np.array(values, np.float32), FEATURE_DIM))
    assert describe(row).isfinite().all()


def test_a_row_that_is_not_finite_does_not_vanish() -> None:
    row = standing_row()
    row[column("base_height")] = torch.nan
    assert not describe(row).isfinite().all()


def test_names_are_unique_and_every_descriptor_is_explained() -> None:
    assert len(set(DESCRIPTOR_NAMES)) == len(DESCRIPTORS)
    assert all(item.unit and item.meaning for item in DESCRIPTORS)


def clip_of(heights: list[float], *, falls: bool = False) -> np.ndarray:
    rows = np.zeros((len(heights), FEATURE_DIM), dtype=np.float32)
    rows[:, column("base_height")] = np.array(heights)[:, None]
    rows[-1, column("fallen")] = falls
    return rows


def mean_heights(clips: ClipBatch) -> list[float]:
    heights = clips.features[..., column("base_height")][..., 0]
    return mean_over(heights, clips.scored).tolist()


def test_clips_of_unequal_length_are_compared_by_their_means() -> None:
    """(1 + 2 + 3) / 3 = 2 and (4 + 0) / 2 = 2, whatever the padding."""
    clips = pad_clips([clip_of([1.0, 2.0, 3.0]), clip_of([4.0, 0.0])])
    assert clips.valid.tolist() == [[True, True, True], [True, True, False]]
    assert mean_heights(clips) == [2.0, 2.0]


def test_the_row_of_a_fall_is_left_out_of_the_mean() -> None:
    clips = pad_clips([clip_of([1.0, 3.0, 9.0], falls=True), clip_of([1.0, 3.0, 8.0])])
    assert clips.fell.tolist() == [True, False]
    assert mean_heights(clips) == [2.0, 4.0]


def test_a_clip_that_falls_at_once_counts_as_average() -> None:
    clips = pad_clips([clip_of([5.0], falls=True)])
    assert mean_heights(clips) == [0.0]


def test_clips_that_cannot_be_are_refused() -> None:
    with pytest.raises(ValueError, match="at least one clip, and each clip a step"):
        pad_clips([])
    with pytest.raises(ValueError, match="not finite"):
        pad_clips([clip_of([1.0, np.nan])])
    half = clip_of([1.0, 2.0])
    half[:, column("joint_torque").start] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        pad_clips([half])
