"""A held key, a double click and a late event never make an answer."""

import datetime

import pytest

from labeling_ui.questions.judgement import Judgement, Verdict
from labeling_ui.questions.key_repeat import GuardCfg, GuardState, weigh

CFG = GuardCfg()
START = datetime.datetime(2030, 1, 31, 12, tzinfo=datetime.UTC)


def at(seconds: float) -> datetime.datetime:
    return START + datetime.timedelta(seconds=seconds)


def judgement(
    question_id: str, verdict: Verdict = "left", *, dialog_open: bool = False
) -> Judgement:
    return Judgement(question_id=question_id, verdict=verdict, dialog_open=dialog_open)


def answered(
    events: list[tuple[float, Verdict]], *, next_after_s: float = 0.15
) -> list[float]:
    """Times of accepted events; the next question appears a little after an answer."""
    state = GuardState().on_screen("0", at(-10.0))
    accepted: list[float] = []
    for time_s, verdict in events:
        if accepted and time_s >= accepted[-1] + next_after_s:
            appeared = at(accepted[-1] + next_after_s)
            state = state.on_screen(str(len(accepted)), appeared)
        shown = state.question_id or ""
        state, reason = weigh(state, judgement(shown, verdict), at(time_s), CFG)
        if not reason:
            accepted.append(time_s)
    return accepted


@pytest.mark.parametrize("delay_s", [0.25, 0.5, 0.66, 1.0])
@pytest.mark.parametrize("period_s", [0.03, 0.1, 0.2])
def test_a_held_key_answers_once(delay_s: float, period_s: float) -> None:
    """For ten seconds, whatever the keyboard's delay and rate."""
    repeats = [delay_s + period_s * number for number in range(round(10 / period_s))]
    assert answered([(time_s, "left") for time_s in [0.0, *repeats]]) == [0.0]


@pytest.mark.parametrize("gap_s", [0.05, 0.2, 0.5, 0.9])
def test_a_double_click_answers_once(gap_s: float) -> None:
    """However slow it is."""
    assert answered([(0.0, "left"), (gap_s, "left")]) == [0.0]


def test_a_quick_person_is_not_held_up() -> None:
    """Three pairs in four seconds, the same verdict twice."""
    events: list[tuple[float, Verdict]] = [
        (0.0, "left"),
        (1.4, "left"),
        (2.2, "right"),
        (3.5, "equal"),
    ]
    assert answered(events) == [0.0, 1.4, 2.2, 3.5]


def test_a_pair_that_has_just_appeared_cannot_be_answered() -> None:
    """It was not looked at."""
    assert answered([(0.0, "left"), (0.5, "right"), (0.7, "equal")]) == [0.0, 0.7]


@pytest.mark.parametrize(
    ("state", "said", "reason"),
    [
        (GuardState(), judgement("q"), "not on the screen any more"),
        (GuardState().on_screen("p", at(0)), judgement("q"), "not on the screen"),
        (
            GuardState().on_screen("q", at(0)),
            judgement("q", dialog_open=True),
            "dialog",
        ),
        (GuardState().on_screen("q", at(9.9)), judgement("q"), "only just appeared"),
        (GuardState().on_screen("q", at(0)), judgement("q"), ""),
        (GuardState().on_screen("q", at(3600)), judgement("q"), ""),
    ],
)
def test_every_refusal_has_a_reason(
    state: GuardState, said: Judgement, reason: str
) -> None:
    """A clock that was set back, the last case, locks nobody out."""
    _, found = weigh(state, said, at(10.0), CFG)
    assert reason in found
    assert bool(found) == bool(reason)


def test_showing_a_question_again_does_not_restart_its_time() -> None:
    """The page asks once a second what is to be shown."""
    state = GuardState().on_screen("q", at(0))
    assert state.on_screen("q", at(5)) is state
