"""Clips are cut where the rules say, worked out by hand."""

from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from data.episodes.clips import Clip, cut_clips
from data.episodes.episode import END_REASONS, EndReason


@dataclass(frozen=True)
class Entry:
    sha256: str
    num_steps: int
    end_reason: EndReason


def cuts(
    num_steps: int, end_reason: EndReason, stride: int = 50
) -> list[tuple[int, int]]:
    """Start and stop of the clips of 50 steps, at least 20."""
    entry = Entry("e", num_steps, end_reason)
    clips = cut_clips([entry], steps=50, stride=stride, min_steps=20)
    return [(clip.start, clip.stop) for clip in clips]


def test_an_episode_that_ran_out_of_time_gives_whole_clips_only() -> None:
    """120 steps hold [0, 50) and [50, 100); the rest is left."""
    assert cuts(120, "truncated") == [(0, 50), (50, 100)]
    assert cuts(49, "truncated") == []


def test_the_last_clip_before_a_fall_ends_at_the_fall() -> None:
    """130 steps: the last clip keeps its true length of 30."""
    assert cuts(130, "terminated") == [(0, 50), (50, 100), (100, 130)]
    assert cuts(100, "terminated") == [(0, 50), (50, 100)]
    assert cuts(30, "terminated") == [(0, 30)]


def test_a_rest_too_short_to_judge_is_filled_up_to_a_whole_clip() -> None:
    """110 steps: 10 are too few, so the clip starts at 60; 19 in all give none."""
    assert cuts(110, "terminated") == [(0, 50), (50, 100), (60, 110)]
    assert cuts(19, "terminated") == []


def test_overlapping_clips_end_once_at_the_fall() -> None:
    """With a stride of 25 and 90 steps, [50, 90) is the one shorter clip."""
    assert cuts(90, "terminated", stride=25) == [(0, 50), (25, 75), (50, 90)]


def test_aborted_episodes_are_never_shown() -> None:
    """Their last steps are the simulator's, not the robot's."""
    assert cuts(500, "aborted") == []


@given(
    num_steps=st.integers(1, 300),
    end_reason=st.sampled_from(END_REASONS),
    steps=st.integers(1, 60),
    stride=st.integers(1, 80),
    data=st.data(),
)
def test_clips_lie_in_their_episode(
    num_steps: int, end_reason: EndReason, steps: int, stride: int, data: st.DataObject
) -> None:
    """Whatever the lengths, no clip leaves the episode, is doubled, or is too short."""
    min_steps = data.draw(st.integers(1, steps))
    entry = Entry("e", num_steps, end_reason)
    clips = cut_clips([entry], steps=steps, stride=stride, min_steps=min_steps)
    assert len(set(clips)) == len(clips)
    assert all(min_steps <= clip.steps <= steps for clip in clips)
    assert all(clip.stop <= num_steps for clip in clips)
    if end_reason == "terminated" and num_steps >= min_steps:
        assert clips[-1].stop == num_steps


def test_clips_describe_themselves() -> None:
    """The key is pinned: answers of years refer to it."""
    clip = Clip("ab12", 10, 50)
    assert clip.key == "ab12:10+50"
    assert clip.rows == slice(10, 60)
    assert clip < Clip("ab12", 11, 1)
    with pytest.raises(ValueError, match="start >= 0 and steps >= 1"):
        Clip("ab12", 0, 0)
    with pytest.raises(ValueError, match="0 < min_steps <= steps"):
        cut_clips([], steps=5, stride=5, min_steps=6)
