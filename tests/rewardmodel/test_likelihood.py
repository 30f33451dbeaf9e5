"""Bradley-Terry with ties and wrong answers, against hand-made numbers and laws."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from rewardmodel.answers.likelihood import (
    answer_log_probabilities,
    log_likelihood,
    log_likelihood_derivatives,
)

LOGITS = st.floats(-50, 50)
THRESHOLDS = st.one_of(st.just(0.0), st.floats(0.01, 5))
SHARES = st.one_of(st.just(0.0), st.floats(0.01, 0.9))


def probabilities(logit: float, d: float, e: float) -> list[float]:
    value = torch.tensor(logit, dtype=torch.float64)
    log_p = answer_log_probabilities(value, tie_threshold=d, error_share=e)
    return log_p.exp().tolist()


def likelihood(logit: float, target: float, d: float, e: float) -> float:
    return math.exp(
        log_likelihood(
            torch.tensor(logit, dtype=torch.float64),
            torch.tensor(target, dtype=torch.float64),
            tie_threshold=d,
            error_share=e,
        ).item()
    )


def test_without_ties_or_errors_it_is_bradley_terry() -> None:
    """1 / (1 + e^-1) = 0.7310586."""
    assert probabilities(1.0, 0.0, 0.0) == pytest.approx([0.7310586, 0.2689414, 0.0])


def test_a_tie_by_hand() -> None:
    """At threshold ln 2 a lead of 0 gives 1/3 each: (4 - 1) / 3 / 3 = 1/3."""
    assert probabilities(0.0, math.log(2), 0.0) == pytest.approx([1 / 3] * 3)


def test_a_lead_with_ties_by_hand() -> None:
    """Lead ln 4, threshold ln 2: s(ln 2) = 2/3, s(-ln 8) = 1/9, tie 2/9."""
    expected = [2 / 3, 1 / 9, 2 / 9]
    assert probabilities(math.log(4), math.log(2), 0.0) == pytest.approx(expected)


def test_wrong_answers_by_hand() -> None:
    """A share of 0.3: 0.7 * 2/3 + 0.1, and without ties 0.7 * 4/5 + 0.15."""
    with_ties = probabilities(math.log(4), math.log(2), 0.3)
    assert with_ties == pytest.approx([0.7 * 2 / 3 + 0.1, 0.7 / 9 + 0.1, 1.4 / 9 + 0.1])
    without = probabilities(math.log(4), 0.0, 0.3)
    assert without == pytest.approx([0.71, 0.29, 0.0])


def test_a_graded_answer_is_part_side_and_part_tie() -> None:
    """Target 0.75 is half an answer "left" and half a tie."""
    left, _, tie = probabilities(0.4, 0.5, 0.2)
    assert likelihood(0.4, 0.75, 0.5, 0.2) == pytest.approx(math.sqrt(left * tie))


def test_without_ties_an_equal_answer_is_half_for_either_side() -> None:
    left, right, _ = probabilities(0.4, 0.0, 0.2)
    assert likelihood(0.4, 0.5, 0.0, 0.2) == pytest.approx(math.sqrt(left * right))


@given(LOGITS, THRESHOLDS, SHARES)
def test_probabilities_sum_to_one(logit: float, d: float, e: float) -> None:
    assert sum(probabilities(logit, d, e)) == pytest.approx(1.0, abs=1e-12)


@given(LOGITS, THRESHOLDS, SHARES)
def test_swapping_the_sides_swaps_the_probabilities(
    logit: float, d: float, e: float
) -> None:
    left, right, tie = probabilities(logit, d, e)
    assert probabilities(-logit, d, e) == pytest.approx([right, left, tie])


@given(LOGITS, st.floats(0, 1), THRESHOLDS, SHARES)
def test_swapping_sides_and_answer_changes_nothing(
    logit: float, target: float, d: float, e: float
) -> None:
    swapped = likelihood(-logit, 1 - target, d, e)
    assert swapped == pytest.approx(likelihood(logit, target, d, e))


@given(st.floats(-20, 20), st.floats(0, 1), THRESHOLDS, SHARES)
def test_the_derivatives_are_those_of_the_likelihood(
    logit: float, target: float, d: float, e: float
) -> None:
    """Compared with what automatic differentiation finds, twice over."""
    value = torch.tensor(logit, dtype=torch.float64, requires_grad=True)
    answer = torch.tensor(target, dtype=torch.float64)
    total = log_likelihood(value, answer, tie_threshold=d, error_share=e)
    (slope,) = torch.autograd.grad(total, value, create_graph=True)
    (bend,) = torch.autograd.grad(slope, value)
    found = log_likelihood_derivatives(
        value.detach(), answer, tie_threshold=d, error_share=e
    )
    assert torch.allclose(found[0], slope, atol=1e-9)
    assert torch.allclose(found[1], bend, atol=1e-9)


def test_extreme_leads_stay_finite() -> None:
    """float32 logits of a thousand give finite values and derivatives."""
    logit = torch.tensor([-1000.0, 1000.0])
    target = torch.tensor([1.0, 0.5])
    value = log_likelihood(logit, target, tie_threshold=0.5, error_share=0.0)
    assert value.tolist() == pytest.approx([-1000.5, -1000.5 + math.log(math.e - 1)])
    slope, bend = log_likelihood_derivatives(
        logit, target, tie_threshold=0.5, error_share=0.3
    )
    assert slope.isfinite().all()
    assert bend.isfinite().all()
