"""Answers are shared out to the last one, whatever is asked for and kept."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gaitpref.method.budget import FrontLoaded
from gaitpref.method.context import RoundContext
from gaitpref.method.method import FROM_SCRATCH, STYLE
from rewardmodel.answers.answered_pairs import MIN_ANSWERS

BUDGETS = {
    "style": STYLE.budget,
    "scratch": FROM_SCRATCH.budget,
    "own only": FrontLoaded(first_share=0.4),
    "all at first": FrontLoaded(
        first_share=0.99, first_least=1000, most_first_share=0.99
    ),
    "little at first": FrontLoaded(first_share=0.01, first_least=0),
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
    """Whatever the first round went on to, and whatever is kept for the last."""
    budget = BUDGETS[name]
    first = RoundContext(number=0, rounds=rounds, labels=labels)
    for wanted in (0, 1, 7, labels):
        kept = budget.most_kept(first, wanted)
        assert 0 <= kept <= wanted
        own = budget.labels_of(first, kept=kept)
        most = max(own, budget.most_first(first, kept=kept))
        for asked in {own, (own + most) // 2, most}:
            later = [
                replace(first, number=number, first_asked=asked)
                for number in range(1, rounds + 1)
            ]
            begun = replace(first, first_asked=asked)
            assert budget.labels_of(begun, kept=kept) == asked
            assert budget.most_kept(later[-1], wanted) >= kept
            found = [budget.labels_of(each, kept=kept) for each in later]
            assert found[-1] == kept
            assert asked + sum(found) == labels
            assert min([asked, *found[:-1]]) >= min(budget.least, labels)
            assert asked >= MIN_ANSWERS


def test_what_is_kept_is_what_the_others_can_spare() -> None:
    """The first needs eight answers, those between it and the last so many each; fewer
    than four at the end decide nothing."""
    budget = FrontLoaded(first_share=0.4, least=2)
    for labels, kept in ((12, 0), (15, 0), (16, 4), (18, 6), (20, 7), (60, 7)):
        last = RoundContext(number=3, rounds=3, labels=labels)
        assert budget.most_kept(last, 7) == kept, labels
    asked = RoundContext(number=3, rounds=3, labels=60, first_asked=52)
    assert budget.most_kept(asked, 7) == 4


def test_of_a_single_round_all_is_asked_at_once() -> None:
    for budget in BUDGETS.values():
        only = RoundContext(number=0, rounds=1, labels=12)
        assert budget.labels_of(only) == 12
        assert budget.most_first(only) == 0
        assert budget.labels_of(replace(only, number=1)) == 0
        assert budget.labels_of(only, kept=4) == 8


def test_the_first_round_may_go_on_to_its_share_and_leaves_enough() -> None:
    first = RoundContext(number=0, rounds=4, labels=100)
    for share, most in ((0.75, 75), (0.999, 88), (0.01, MIN_ANSWERS), (0.0, 0)):
        budget = FrontLoaded(first_share=0.4, most_first_share=share)
        assert budget.most_first(first) == most


@pytest.mark.parametrize("share", [-0.1, 1.0, float("nan")])
def test_shares_that_are_none_are_refused(share: float) -> None:
    with pytest.raises(ValueError, match=r"most_first_share must lie in \[0, 1\)"):
        FrontLoaded(first_share=0.5, first_least=0, most_first_share=share)
    with pytest.raises(ValueError, match=r"first_share must lie in \(0, 1\)"):
        FrontLoaded(first_share=share, first_least=0)


@pytest.mark.parametrize(("number", "rounds"), [(-1, 3), (4, 3), (1, 0)])
def test_a_round_that_is_none_is_refused(number: int, rounds: int) -> None:
    with pytest.raises(ValueError, match=rf"number must lie in \[0, rounds {rounds}\]"):
        RoundContext(number=number, rounds=rounds, labels=60)
