"""The clock of both clips, without viser and without waiting."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labeling_ui.page.playback import HOLD_S, SPEEDS, Playback

CLOCK = Playback(duration_s=1.2, frame_s=0.02)


def test_it_runs_at_its_speed() -> None:
    """Half a second at double speed is one second of the clips."""
    clock = CLOCK.at_speed(2.0).advance(0.5)
    assert clock.time_s == pytest.approx(1.0)
    assert clock.watched_s == pytest.approx(0.5)


def test_the_last_pose_is_held_and_then_it_begins_again() -> None:
    clock = CLOCK.advance(1.2 + HOLD_S / 2)
    assert clock.at_end
    assert clock.replays == 0
    clock = clock.advance(HOLD_S)
    assert clock.time_s == pytest.approx(HOLD_S / 2)
    assert clock.replays == 1


def test_a_step_is_one_recorded_state_and_stops_the_clock() -> None:
    clock = CLOCK.advance(0.507).step(1)
    assert not clock.playing
    assert clock.time_s == pytest.approx(0.52)
    assert clock.step(-1).time_s == pytest.approx(0.50)
    assert CLOCK.step(-1).time_s == 0.0
    assert CLOCK.step(1000).time_s == CLOCK.duration_s


def test_paused_at_the_end_play_means_replay() -> None:
    clock = CLOCK.seek(9.0).toggle()
    assert clock.playing
    assert clock.time_s == 0.0
    assert clock.replays == 1


def test_a_paused_clock_does_not_count_as_watched() -> None:
    clock = CLOCK.toggle().advance(5.0)
    assert clock.time_s == 0.0
    assert clock.watched_s == 0.0


def test_speeds_stop_at_the_ends() -> None:
    assert CLOCK.faster(99).speed == SPEEDS[-1]
    assert CLOCK.faster(-99).speed == SPEEDS[0]
    with pytest.raises(ValueError, match="speed must be one of"):
        CLOCK.at_speed(3.0)


def test_a_clock_needs_a_length() -> None:
    with pytest.raises(ValueError, match="must be positive"):
        Playback(duration_s=0.0, frame_s=0.02)


@given(
    st.lists(st.floats(0.0, 3.0), max_size=20),
    st.sampled_from(SPEEDS),
    st.floats(0.05, 5.0),
)
def test_many_small_steps_are_one_long_one(
    parts: list[float], speed: float, duration_s: float
) -> None:
    """Neither the ticker's period nor its hiccups change where the clock is."""
    start = Playback(duration_s=duration_s, frame_s=0.02, speed=speed)
    clock = start
    for part in parts:
        clock = clock.advance(part)
        assert 0.0 <= clock.time_s <= clock.duration_s
        assert 0.0 <= clock.held_s <= HOLD_S + 1e-9
    cycle = (sum(parts) - clock.replays * start.cycle_s) - clock.cycle_position_s
    assert cycle == pytest.approx(0.0, abs=1e-6) or abs(cycle) == pytest.approx(
        start.cycle_s, abs=1e-6
    )
