"""When more answers will not help: said late by who learns, never of a coin."""

from __future__ import annotations

import pytest

from rewardmodel import FitCfg, fit_reward

from .test_rewardmodel_fit import answered


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
