"""Which curves matter: sets of few, each as probable as the answers make it.

Pairs are drawn so that a curve's worth is known; the curves are plain numbers here.
"""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from rewardmodel.explanations import (
    Explanation,
    explanations,
    shared_out,
    weights_of,
)
from rewardmodel.forward import chosen_curves
from rewardmodel.training import TrainingPairs

from .test_rewardmodel_forward import (
    ALL,
    CFG,
    CURVES,
    WEIGHTS,
    answers,
    drawn,
    kept,
    ones,
)


def explained(
    curves: Tensor, pairs: TrainingPairs, *, allowed: Tensor = ALL
) -> list[Explanation]:
    return explanations(curves, pairs, CFG, allowed=allowed)


@pytest.mark.parametrize(("count", "wanted"), [(40, {3}), (120, {3, 7})])
def test_it_takes_what_the_answers_are_about(count: int, wanted: set[int]) -> None:
    """One curve, or two of which the one says half as much; no other by chance."""
    curves = drawn(count)
    lead = sum(curves[:, g, 0] * (1.0 if g == 3 else 0.5) for g in wanted)
    pairs = answers(torch.as_tensor(lead))
    best = explained(curves, pairs)[:1]
    assert set(best[0].curves) == wanted
    theta, variance = weights_of(best, curves, pairs, ones(1, count), CFG)
    left_out = [g for g in range(CURVES) if g not in wanted]
    of_curves = theta.unflatten(1, (CURVES, WEIGHTS))
    assert (of_curves[:, left_out] == 0).all()
    assert (of_curves[:, sorted(wanted), 0] > 0).all()
    assert kept(variance) == [wanted]
    foreseen = (curves.flatten(1) @ theta[0] > 0) == (pairs.target > 0.5)
    assert foreseen.double().mean() > 0.9


def test_what_was_taken_first_is_given_up_again() -> None:
    """A curve that goes with two others says more than either, and less than both."""
    curves = drawn(80)
    both = curves[:, 2] + curves[:, 5]
    curves[:, 8] = both + 0.8 * drawn(80, seed=1)[:, 0]
    pairs = answers(both[:, 0])
    _, variance = chosen_curves(curves, pairs, ones(1, 80), CFG, allowed=ALL)
    assert 8 in kept(variance)[0]
    assert set(explained(curves, pairs)[0].curves) == {2, 5}


def test_every_set_is_found_once_and_the_best_is_first() -> None:
    curves = drawn(60)
    found = explained(curves, answers(curves[:, 3, 0] + 0.3 * curves[:, 4, 0]))
    assert len({(frozenset(e.curves), e.strength) for e in found}) == len(found) > 10
    log_odds = [each.log_odds for each in found]
    assert log_odds == sorted(log_odds, reverse=True)


def test_members_take_others_where_the_answers_leave_it_open() -> None:
    """Two curves that hardly differ: who took the same one would hide that."""
    curves = drawn(40)
    curves[:, 5] = curves[:, 2] + 0.3 * drawn(40, seed=1)[:, 0]
    found = explained(curves, answers(curves[:, 2, 0] + curves[:, 5, 0]))
    taken = [set(each.curves) for each in shared_out(found, 16)]
    assert any(2 in each for each in taken)
    assert any(5 in each for each in taken)


def test_members_share_what_is_found_by_how_probable_it_is() -> None:
    """Three to one, in that order."""
    odds = (0.75, 0.25 - 1e-6, 1e-6)
    found = [
        Explanation(curves=(g,), strength=1.0, log_odds=math.log(share) - 40)
        for g, share in enumerate(odds)
    ]
    assert [e.curves for e in shared_out(found, 8)] == [(0,)] * 6 + [(1,)] * 2


def test_what_is_not_allowed_is_never_taken() -> None:
    curves = drawn(60)
    found = explained(curves, answers(curves[:, 3, 0]), allowed=ALL[ALL != 3])
    assert all(3 not in each.curves for each in found)
