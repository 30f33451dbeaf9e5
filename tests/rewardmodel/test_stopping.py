"""When more answers will not help: said late by who learns, never of a coin."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import pytest
import torch

from data.features import column
from rewardmodel import FitCfg, fit_reward
from tests.rewardmodel.test_fit import answered


@pytest.mark.parametrize(("flipped", "plenty"), [(0.0, 640), (0.2, 1280)])
def test_it_says_go_on_early_and_stop_late(flipped: float, plenty: int) -> None:
    """After 40 answers clips are still in doubt, after 640 next to none; with a fifth
    of them wrong it takes twice as many, as it should."""
    _, early = fit_reward(answered(40, seed=1, flipped=flipped), FitCfg(), seed=0)
    _, late = fit_reward(answered(plenty, seed=1, flipped=flipped), FitCfg(), seed=0)
    assert not early.enough
    assert late.enough
    assert early.open_share is not None
    assert late.open_share is not None
    assert late.open_share < 0.2 < early.open_share


@pytest.mark.parametrize("count", [40, 160, 640])
def test_answers_at_random_are_never_enough(count: int) -> None:
    _, report = fit_reward(answered(count, seed=1, flipped=0.5), FitCfg(), seed=0)
    assert not report.enough


@pytest.mark.parametrize("kind", ["linear", "posterior"])
def test_who_calls_all_clips_equal_has_told_nothing(
    kind: Literal["linear", "posterior"],
) -> None:
    """Members without an opinion do not agree: the order of all clips is open."""
    pairs = answered(40, seed=1)
    ties = replace(pairs, target=torch.full((40,), 0.5))
    model, report = fit_reward(ties, FitCfg(kind=kind), seed=0)
    assert (model.clip_returns(ties.left).std(dim=1) < 1e-4).all()
    assert report.agreement is not None
    assert report.agreement < 0.9
    assert not report.enough
    assert report.open_share == 1.0
    assert not report.enough


def test_that_falls_cost_all_members_the_same_is_no_agreement() -> None:
    """A clip that ends in a fall is worse than any, and all others are equal."""
    pairs = answered(40, seed=1)
    features = pairs.left.features.clone()
    features[::3, -1, column("fallen")] = 1.0
    fallen = replace(pairs.left, features=features, checked=True)
    target = torch.where(fallen.fell, 0.0, 0.5)
    some_fall = replace(pairs, left=fallen, target=target)
    model, report = fit_reward(some_fall, FitCfg(kind="posterior"), seed=0)
    assert (model.clip_returns(fallen).std(dim=1) > 0.1).all()
    assert report.agreement is not None
    assert report.agreement < 0.9
    assert not report.enough


def test_who_has_no_lead_is_right_half_of_the_time() -> None:
    """However often the right answer is the right clip."""
    pairs = answered(40, seed=1)
    flat = replace(
        pairs,
        left=pairs.right,
        target=torch.tensor([0.0] * 30 + [1.0] * 10),
    )
    _, report = fit_reward(flat, FitCfg(), seed=0)
    assert report.train_accuracy == 0.5
