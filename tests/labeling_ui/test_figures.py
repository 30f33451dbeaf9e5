"""Figures of raters, worked out by hand."""

import datetime
from pathlib import Path
from typing import Any

import pytest

from data.answers.answer_records import Answer, Choice, Pair
from data.answers.store import AnswerStore
from data.episodes.clips import Clip
from labeling_ui.questions.rater_figures import (
    Row,
    Share,
    all_figures,
    alpha,
    figures,
    rater_figures,
)
from labeling_ui.questions.rater_table import table_of
from labeling_ui.web.pages import figures_page

START = datetime.datetime(2030, 1, 31, 12, tzinfo=datetime.UTC)
CHOICES: dict[float | None, Choice] = {1.0: "a", 0.75: "a", 0.5: "equal"}


def row(rater_id: str, pair: int, p_a: float | None, **more: Any) -> Row:
    """An answer; `gold` and `second` say what is known and when it was given."""
    info = {"gold": more.pop("gold")} if "gold" in more else {}
    second = more.pop("second", 0)
    made = Pair.make(
        Clip("aa", pair, 50), Clip("bb", pair, 50), strategy="x", round=0, info=info
    )
    values = {
        "answer_id": f"{rater_id}-{pair}-{more.get('role', 'first')}",
        "pair_id": made.pair_id,
        "rater_id": rater_id,
        "choice": "skip" if p_a is None else CHOICES.get(p_a, "b"),
        "p_a": p_a,
        "shown_left": "a",
        "created_utc": (START + datetime.timedelta(seconds=second)).isoformat(),
    }
    return made, Answer(**(values | more))


def test_nothing_gives_no_figures() -> None:
    """A share of nothing is not zero."""
    found = figures([], "ada")
    assert found.answers == 0
    assert (found.per_hour, found.median_s, found.alpha) == (None, None, None)
    assert {found.left.share, found.gold.share, found.agreement.share} == {None}


def test_speed_leaves_pauses_out() -> None:
    """Gaps of 10 s, 20 s, a lunch, and 30 s: three answers in a minute, 180 an hour."""
    seconds = [0, 10, 30, 4000, 4030]
    rows = [row("ada", n, 1.0, second=second) for n, second in enumerate(seconds)]
    assert figures(rows, "ada").per_hour == pytest.approx(180.0)
    assert figures(rows[:1], "ada").per_hour is None


def test_a_rater_who_speeds_up_is_seen() -> None:
    """Twelve answers of the last hour, ever faster; those of the day before are left
    out, and few answers tell nothing."""
    before = [row("ada", n, 1.0, second=n, shown_ms=60_000) for n in range(20)]
    hour = [
        row("ada", 20 + n, 1.0, second=90_000 + 300 * n, shown_ms=1000 * (13 - n))
        for n in range(12)
    ]
    assert figures(before + hour, "ada").pace_s == (12.0, 9.0, 6.0, 3.0)
    assert figures(hour[:5], "ada").pace_s == ()


def test_people_side_by_side_do_not_share_an_hour() -> None:
    """Two at 360 an hour each are 360 an hour of work."""
    rows = [row(name, n, 1.0, second=10 * n) for name in "ab" for n in range(5)]
    assert all_figures(rows).per_hour == pytest.approx(360.0)


def test_times_count_from_the_first_frame() -> None:
    """Where it is not known, from when the pair was shown: median of 1, 3 and 8 s."""
    rows = [
        row("ada", 0, 1.0, response_ms=1000, shown_ms=9000),
        row("ada", 1, 1.0, response_ms=3000),
        row("ada", 2, 1.0, shown_ms=8000),
        row("ada", 3, 1.0),
    ]
    found = figures(rows, "ada")
    assert found.median_s == 3.0
    assert (found.fast.hits, found.fast.of) == (1, 3)


def test_a_habit_of_the_left_side_shows() -> None:
    """Two of three preferences; equal and can't tell are none."""
    rows = [
        row("ada", 0, 1.0, shown_left="a"),
        row("ada", 1, 0.25, shown_left="b"),
        row("ada", 2, 0.0, shown_left="a"),
        row("ada", 3, 0.5),
        row("ada", 4, None),
    ]
    found = figures(rows, "ada").left
    assert (found.hits, found.of) == (2, 3)


def test_how_often_a_reason_is_said_shows() -> None:
    """Of three preferences; who calls both equal has none to say."""
    rows = [row("ada", 0, 1.0, why="feet"), *(row("ada", n, 1.0) for n in (1, 2))]
    found = figures([*rows, row("ada", 3, 0.5)], "ada")
    assert found.why == Share(1, 3)
    assert "33% of 3" in figures_page(found, can_leave=False)
    (line,) = (line for line in table_of([found]) if line.startswith("ada"))
    assert "33% of 3" in line


def test_consistency_compares_the_clips_not_the_sides() -> None:
    """One of two repeats holds; a repeat that can't tell says nothing."""
    rows = [
        row("ada", 0, 1.0, shown_left="a"),
        row("ada", 0, 0.75, shown_left="b", role="repeat"),
        row("ada", 1, 1.0, shown_left="a"),
        row("ada", 1, 0.0, shown_left="b", role="repeat"),
        row("ada", 2, 1.0),
        row("ada", 2, None, role="repeat"),
        row("bob", 3, 1.0, role="repeat"),
    ]
    found = figures(rows, "ada").self_consistency
    assert (found.hits, found.of) == (1, 2)
    assert all_figures(rows).self_consistency == found


def test_known_answers_are_met_or_not() -> None:
    """Two of four: can't tell is a miss, the strength does not matter."""
    rows = [
        row("ada", 0, 0.75, gold="a"),
        row("ada", 1, 0.5, gold="equal"),
        row("ada", 2, 1.0, gold="b"),
        row("ada", 3, None, gold="a"),
        row("ada", 4, 1.0),
    ]
    found = figures(rows, "ada").gold
    assert (found.hits, found.of) == (2, 4)


def test_agreement_counts_every_two_people() -> None:
    """Three people on one pair are three twos; repeats and can't tell do not count."""
    rows = [
        row("ada", 0, 1.0),
        row("bob", 0, 0.75),
        row("cy", 0, 0.0),
        row("ada", 1, 0.5),
        row("bob", 1, 0.5),
        row("ada", 2, 1.0),
        row("bob", 2, None),
        row("cy", 2, 0.0, role="repeat"),
    ]
    found = all_figures(rows).agreement
    assert (found.hits, found.of) == (2, 4)
    own = figures(rows, "ada").agreement
    assert (own.hits, own.of) == (2, 3), "bob and cy are none of ada's business"


def test_agreement_is_told_over_time() -> None:
    """Twelve of twelve, eleven, nine and six, with others and with known answers
    together; too few tell nothing, nor do all raters together."""
    right = [12 * [True], 11 * [True] + [False], 9 * [True] + 3 * [False]]
    right.append(6 * [True] + 6 * [False])
    rows = []
    for number, agrees in enumerate(same for quarter in right for same in quarter):
        told = 1.0 if agrees else 0.0
        if number % 2:
            rows.append(row("ada", number, told, second=number, gold="a"))
        else:
            rows.append(row("ada", number, told, second=number))
            rows.append(row("bob", number, 1.0, second=1000 - number))
    found = figures(rows[::-1], "ada")
    counts = [(part.hits, part.of) for part in found.agreed]
    assert counts == [(12, 12), (11, 12), (9, 12), (6, 12)]
    assert "100%, 92%, 75%, 50%" in table_of([found])[2]
    assert "100%, 92%, 75%, 50%" in figures_page(found, can_leave=False)
    assert figures(rows, "bob").agreed == ()
    assert all_figures(rows).agreed == ()
    assert figures(rows[:50], "ada").agreed == ()


def test_alpha_of_two_values() -> None:
    """Units (0,0), (0,1), (1,1): observed 2/6, expected 18/30, alpha 1 - 5/9."""
    votes = [(0.0, 0.0), (0.0, 1.0), (1.0, 1.0)]
    rows = [
        row(name, n, vote)
        for n, both in enumerate(votes)
        for name, vote in zip("ab", both, strict=True)
    ]
    assert alpha(rows) == pytest.approx(4 / 9)
    rows.append(row("a", 7, 0.0))
    assert alpha(rows) == pytest.approx(4 / 9), "what one person answered says nothing"


def test_alpha_forgives_neighbours() -> None:
    """Much better against better is less of a quarrel than against much worse."""

    def quarrel(other: float) -> float | None:
        votes = [(1.0, other), (0.0, 0.0), (1.0, 1.0), (0.75, 0.75), (0.25, 0.25)]
        return alpha(
            [
                row(name, n, vote)
                for n, both in enumerate(votes)
                for name, vote in zip("ab", both, strict=True)
            ]
        )

    near, far = quarrel(0.75), quarrel(0.0)
    assert near is not None
    assert far is not None
    assert far < near < 1.0
    assert quarrel(1.0) == pytest.approx(1.0)


def test_alpha_is_undefined_without_difference() -> None:
    """All answers equal, or no pair in common."""
    assert alpha([row("a", 0, 1.0), row("b", 0, 1.0)]) is None
    assert alpha([row("a", 0, 1.0), row("b", 1, 0.0)]) is None


def test_only_people_are_compared(tmp_path: Path) -> None:
    """A simulated rater's answers are in the store, not in the figures."""
    with AnswerStore.open(tmp_path / "preferences.sqlite") as store:
        store.add_rater("ada", "human")
        store.add_rater("script", "scripted")
        for pair, answer in (row("ada", 0, 1.0), row("script", 0, 0.0)):
            store.add_pairs([pair])
            store.add_answer(answer)
        found = rater_figures(store, "ada")
    assert found.answers == 1
    assert found.agreement.of == 0
