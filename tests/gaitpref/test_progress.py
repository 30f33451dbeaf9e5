"""What is said of how far something is, where nothing can be drawn."""

from __future__ import annotations

import time

import pytest

from gaitpref.console import progress
from gaitpref.console.progress import (
    counted,
    counting_bar,
    left_told,
    training_bar,
    working,
)
from policy.training.ppo import IterationStats


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody waits for the first word."""
    monkeypatch.setattr(progress, "_QUIET_S", 0.0)


@pytest.mark.usefixtures("at_once")
def test_a_file_is_told_how_much_is_left(capsys: pytest.CaptureFixture[str]) -> None:
    """Done of how many, and the time; nothing more once all is done."""
    with counting_bar("recording", 3) as bar:
        for _ in range(3):
            bar.advance(bar.task_ids[0])
    assert capsys.readouterr().err.splitlines() == [
        "recording: 1 of 3, 0 s left",
        "recording: 2 of 3, 0 s left",
    ]


def test_what_is_quickly_done_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with counting_bar("recording", 2) as bar, working("fitting"):
        bar.advance(bar.task_ids[0])
    assert capsys.readouterr().err == ""


@pytest.mark.usefixtures("at_once")
def test_what_cannot_be_counted_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    with working("fitting"):
        time.sleep(0.2)
    assert capsys.readouterr().err == "fitting ...\n"


@pytest.mark.usefixtures("at_once")
def test_what_does_not_count_yet_is_named_and_then_counted(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """0 begins anew, as the next of several data sets does."""
    with counted("copying") as tell:
        time.sleep(0.2)
        for of in (2, 3):
            for done in range(of):
                tell(done, of)
    assert capsys.readouterr().err.splitlines() == [
        "copying ...",
        "copying: 1 of 2, 0 s left",
        "copying: 1 of 3, 0 s left",
        "copying: 2 of 3, 0 s left",
    ]


def test_what_lasts_says_its_first_word_in_time(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Five seconds from the start, and not from the first part that is done."""
    monkeypatch.setattr(progress, "_QUIET_S", 0.3)
    with counting_bar("fitting, models", 3) as bar:
        time.sleep(0.4)
        bar.advance(bar.task_ids[0])
    assert "fitting, models: 1 of 3" in capsys.readouterr().err


def test_a_training_says_how_much_of_how_many(
    capsys: pytest.CaptureFixture[str],
) -> None:
    stats = IterationStats(
        iteration=1,
        steps=400,
        steps_per_s=10.0,
        mean_return=2.0,
        scalars={"track/planar_error_m_s": 0.1},
    )
    with training_bar("training", 1000) as bar:
        bar(stats)
    said = capsys.readouterr().err
    assert said.startswith("training: 400 of 1,000 steps, 1 min 0 s left ")


@pytest.mark.parametrize(
    ("seconds", "told"),
    [
        (-1, "0 s left"),
        (59.4, "59 s left"),
        (75, "1 min 15 s left"),
        (7260, "2 h 1 min left"),
    ],
)
def test_a_time_is_told_as_people_say_it(seconds: float, told: str) -> None:
    assert left_told(seconds) == told
