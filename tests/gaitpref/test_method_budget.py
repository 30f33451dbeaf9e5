"""Answers are shared out to the last one, whatever is asked for and kept."""

from __future__ import annotations

from dataclasses import replace

import pytest

from data.answers.answer_records import MIN_ANSWERS
from gaitpref.method.budget import FrontLoaded
from gaitpref.method.context import RoundContext
from gaitpref.method.method import FROM_SCRATCH, STYLE, Method

BUDGETS = {
    "style": STYLE.budget,
    "scratch": FROM_SCRATCH.budget,
    "own only": FrontLoaded(first_share=0.4),
    "all at first": FrontLoaded(first_share=0.99),
    "little at first": FrontLoaded(first_share=0.01),
}
GRID = [
    (rounds, MIN_ANSWERS + FrontLoaded.least * (rounds - 1) + spare)
    for rounds in (1, 2, 3, 5, 9)
    for spare in (0, 1, 2, 7, 30, 101, 1000)
]


@pytest.mark.parametrize("name", BUDGETS)
@pytest.mark.parametrize(("rounds", "labels"), GRID)
def test_all_answers_are_asked_for_and_none_twice(
    name: str, rounds: int, labels: int
) -> None:
    """Whatever is kept for the last."""
    budget = BUDGETS[name]
    context = RoundContext(number=0, rounds=rounds, labels=labels)
    for wanted in (0, 1, 7, labels):
        kept = budget.most_kept(context, wanted)
        assert 0 <= kept <= wanted
        found = [
            budget.labels_of(replace(context, number=number), kept=kept)
            for number in range(rounds + 1)
        ]
        assert found[-1] == kept
        assert sum(found) == labels
        assert min(found[:-1]) >= min(budget.least, labels)
        assert found[0] >= MIN_ANSWERS


def test_what_is_kept_is_what_the_others_can_spare() -> None:
    """The first needs eight answers, those between it and the last so many each; fewer
    than four at the end decide nothing."""
    budget = FrontLoaded(first_share=0.4, least=2)
    for labels, kept in ((12, 0), (15, 0), (16, 4), (18, 6), (20, 7), (60, 7)):
        last = RoundContext(number=3, rounds=3, labels=labels)
        assert budget.most_kept(last, 7) == kept, labels


@pytest.mark.parametrize("method", [STYLE, FROM_SCRATCH])
@pytest.mark.parametrize("rounds", [1, 2, 4])
@pytest.mark.parametrize("labels", [12, 20, 40, 60, 80, 100, 150, 200])
def test_answers_that_turn_out_to_err_do_not_make_more_of_them(
    method: Method, rounds: int, labels: int
) -> None:
    """More are kept then for the last policy, of those the first round left."""
    first = RoundContext(number=0, rounds=rounds, labels=labels)
    later = [replace(first, number=n, noisy=True) for n in range(1, rounds + 1)]
    found = [
        method.budget.labels_of(
            context,
            kept=method.labels_kept(context),
            planned=method.labels_planned(context),
        )
        for context in (first, *later)
    ]
    assert sum(found) == labels
    assert found[-1] >= method.labels_planned(first)


def test_of_a_single_round_all_is_asked_at_once() -> None:
    for budget in BUDGETS.values():
        only = RoundContext(number=0, rounds=1, labels=12)
        assert budget.labels_of(only) == 12
        assert budget.labels_of(replace(only, number=1)) == 0
        assert budget.labels_of(only, kept=4) == 8


@pytest.mark.parametrize("share", [-0.1, 0.0, 1.0, float("nan")])
def test_shares_that_are_none_are_refused(share: float) -> None:
    with pytest.raises(ValueError, match=r"first_share must lie in \(0, 1\)"):
        FrontLoaded(first_share=share)


@pytest.mark.parametrize(("number", "rounds"), [(-1, 3), (4, 3), (1, 0)])
def test_a_round_that_is_none_is_refused(number: int, rounds: int) -> None:
    with pytest.raises(ValueError, match=rf"number must lie in \[0, rounds {rounds}\]"):
        RoundContext(number=number, rounds=rounds, labels=60)
