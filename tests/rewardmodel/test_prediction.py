"""How sure an ensemble may be of a pair that its members quarrel about."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from rewardmodel import FitCfg, fit_reward
from rewardmodel.measures.calibration import calibration, fit_temperature
from rewardmodel.models.prediction import Prediction, as_answered
from tests.rewardmodel.test_fit import answered


def generator(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def opinion(lead: Tensor, variance: float, *, members: int, seed: int) -> Prediction:
    """Of members who scatter around `lead` [B]."""
    off = torch.randn(members, len(lead), generator=generator(seed))
    return Prediction.of(lead, lead + variance**0.5 * off)


@pytest.mark.parametrize("variance", [0.1, 1.0, 9.0])
def test_a_logit_is_that_of_the_mean_probability(variance: float) -> None:
    """Beside the mean over very many members: the formula is good to two hundredths."""
    lead = torch.linspace(-6, 6, 25)
    off = torch.randn(20_000, 1, generator=generator(0))
    mean = (lead + variance**0.5 * off).sigmoid().mean(dim=0)
    found = opinion(lead, variance, members=20_000, seed=1).logit.sigmoid()
    assert found.allclose(mean, atol=0.02)
    if variance == 9.0:
        assert (lead.sigmoid() - mean).abs().max() > 0.1


def test_who_is_of_one_mind_is_believed() -> None:
    lead = torch.tensor([-3.0, 0.0, 2.0])
    for members in (1, 7):
        assert Prediction.of(lead, lead.expand(members, -1)).logit.equal(lead)
    assert Prediction.none(3).logit.equal(torch.zeros(3))


def test_questions_that_members_quarrel_about_do_not_speak_for_others() -> None:
    """A temperature found on pairs that members quarrel about, of which they are as
    unsure as they should be, is right for pairs they agree on; found with leads alone
    it makes those too careful."""
    asked = 3 * torch.randn(2000, generator=generator(0))
    quarrel = opinion(asked, 16.0, members=40, seed=1)
    really = asked + 4 * torch.randn(2000, generator=generator(2))
    answers = (torch.rand(2000, generator=generator(3)) < really.sigmoid()).float()
    easy = 3 * torch.randn(2000, generator=generator(4))
    calm = opinion(easy, 0.01, members=40, seed=5)
    fresh = (torch.rand(2000, generator=generator(6)) < easy.sigmoid()).float()

    alike = torch.ones(2000)
    plain = fit_temperature(quarrel.lead, answers, alike)
    by_lead = calibration(easy / plain, fresh)
    own = fit_temperature(quarrel.logit, answers, alike)
    found = calibration(calm.logit / own, fresh)
    assert by_lead is not None
    assert found is not None
    assert found.ece < 0.05 < 0.1 < by_lead.ece


def test_a_saved_temperature_is_that_of_the_probabilities() -> None:
    """What the model says of pairs is what its temperature was found for."""
    pairs = answered(60, seed=0)
    model, report = fit_reward(pairs, FitCfg(), seed=0)
    of_all = model.prediction(pairs.left, pairs.right)
    assert (of_all.variance > 0).all()
    assert of_all.lead.equal(model.lead(pairs.left, pairs.right))
    share = model.provenance.cfg.error_share
    expected = as_answered(of_all.logit / report.temperature, share).sigmoid()
    assert model.logit(pairs.left, pairs.right).sigmoid().equal(expected)
    assert (of_all.logit.abs() < of_all.lead.abs()).all()
