"""What the answers say of the raters and of how strong opinions may be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from rewardmodel import fit_reward
from rewardmodel.answers.answered_pairs import AnsweredPairs
from rewardmodel.answers.clip_batch import ClipBatch, mean_over
from rewardmodel.cfg import FitCfg, LinearCfg
from rewardmodel.descriptors.habits import EFFORT, FEET, TOLD, named
from rewardmodel.descriptors.table import DESCRIPTOR_NAMES, describe
from rewardmodel.linear.laplace import evidence
from rewardmodel.linear.linear import LinearScorer, prior_factor
from rewardmodel.linear.noise_level import FEW_ERRORS, Found, settled, takes_to_err
from rewardmodel.models.kinds import prepare
from tests.rewardmodel.test_fit import DISLIKED, accuracy, answered, taste

FLIPPED = (0.0, 0.2, 0.4)


def found(count: int, flipped: float, seed: int) -> FitCfg:
    pairs = answered(count, seed=seed, flipped=flipped)
    model, _ = fit_reward(pairs, FitCfg(), seed=0, measured=False)
    return model.provenance.cfg


def test_the_share_of_wrong_answers_is_found() -> None:
    """The more answers are turned round, the more are expected to be random."""
    shares = [
        float(np.mean([found(150, flipped, seed).error_share for seed in range(3)]))
        for flipped in FLIPPED
    ]
    assert shares[0] <= 0.1
    assert shares[0] < shares[1] < shares[2]


def hesitant(count: int, seed: int) -> AnsweredPairs:
    """Answers of a rater who errs the more, the closer a pair is: about 30 %."""
    pairs = answered(count, seed=seed)
    lead = taste(pairs.left) - taste(pairs.right)
    right = torch.sigmoid(1.5 * lead / lead.std())
    rng = torch.Generator().manual_seed(seed)
    return replace(pairs, target=(torch.rand(count, generator=rng) < right).float())


def test_both_ways_to_be_wrong_are_expected_of_who_errs() -> None:
    """At random or on close pairs, which is the same share of answers: what is learned
    is right about other pairs. Of answers that agree neither is expected."""
    fresh, usual = answered(400, seed=99), FitCfg().tie_threshold
    for seed in range(3):
        pairs = hesitant(150, seed)
        wrong = (pairs.target > 0.5) != (taste(pairs.left) > taste(pairs.right))
        assert 0.2 < float(wrong.float().mean()) < 0.4
        for asked in (pairs, answered(150, seed=seed, flipped=0.2)):
            model, _ = fit_reward(asked, FitCfg(), seed=0, measured=False)
            cfg = model.provenance.cfg
            assert cfg.error_share >= 0.3
            assert cfg.tie_threshold < usual
            assert accuracy(model, fresh) > 0.75
        assert found(150, 0.0, seed).tie_threshold == usual


def by_the_worst_habit(count: int, seed: int) -> AnsweredPairs:
    """Right answers that no weights can say: only the worst of three habits counts."""
    pairs = answered(count, seed=seed)

    def worst(clips: ClipBatch) -> torch.Tensor:
        means = mean_over(describe(clips.features).mT, clips.scored[:, None])
        shown = [
            means[:, DESCRIPTOR_NAMES.index(name)] / unit
            for name, unit in DISLIKED.items()
        ]
        return torch.stack([each - each.median() for each in shown]).amax(dim=0)

    return replace(pairs, target=(worst(pairs.left) < worst(pairs.right)).float())


def test_answers_err_often_or_hardly_and_nothing_between() -> None:
    """What weights cannot say is no error unless the odds speak for one: then all that
    goes with raters who err is expected, else nothing of it."""
    shares = []
    for seed in range(12):
        pairs = by_the_worst_habit(24, seed)
        model, _ = fit_reward(pairs, FitCfg(), seed=0, measured=False)
        shares.append(model.provenance.cfg.error_share)
    assert all(share <= 0.1 or share >= 0.3 for share in shares)
    assert sum(share <= 0.1 for share in shares) >= 6


def test_opinions_grow_with_the_answers() -> None:
    """Few answers leave the prior where it was; many that agree loosen it."""
    few, many = (found(n, 0.0, 0).linear.prior_precision for n in (8, 300))
    assert many < few
    assert few == FitCfg().linear.prior_precision


def test_what_a_linear_reward_cannot_see_is_no_error() -> None:
    """A model that sees more expects no more errors than before, maybe fewer."""
    tie_threshold = FitCfg().tie_threshold
    many, few = Found(0.7, 3.0, tie_threshold), Found(0.02, 0.1, tie_threshold)
    network = FitCfg(kind="mlp")
    assert settled(network, many, tells_errors=False) == replace(network, adapt=False)
    assert settled(network, few, tells_errors=False) == replace(
        network, adapt=False, error_share=0.02
    )
    linear = settled(FitCfg(), many, tells_errors=True)
    assert (linear.error_share, linear.linear.prior_precision) == (0.7, 3.0)


@pytest.mark.parametrize("flipped", [0.0, 0.4])
def test_whether_answers_err_may_be_decided_before(flipped: float) -> None:
    """Then no answers speak against it, and all that goes with it is expected."""
    pairs, told = answered(100, seed=0, flipped=flipped), LinearCfg(told_most=True)
    for err in (True, False):
        cfg = FitCfg(answers_err=err, linear=told)
        model, _ = fit_reward(pairs, cfg, seed=0, measured=False)
        settled = model.provenance.cfg
        assert takes_to_err(settled) == (settled.error_share > FEW_ERRORS) == err
        assert settled.linear.told_most == err
        assert (settled.tie_threshold, settled.error_share >= 0.3) == (
            (0.3, True) if err else (1.0, False)
        )
    # What a fit decides by itself is what it decides when told so.
    by_itself, _ = fit_reward(pairs, FitCfg(linear=told), seed=0, measured=False)
    assert takes_to_err(by_itself.provenance.cfg) == (flipped > 0.0)
    cfg = FitCfg(answers_err=flipped > 0.0, linear=told)
    model, _ = fit_reward(pairs, cfg, seed=0, measured=False)
    for name, values in by_itself.state_dict().items():
        assert torch.equal(values, model.state_dict()[name])


def test_a_decision_holds_where_shares_are_held() -> None:
    """Of a reward whose share says the opposite, too."""
    for share in (0.02, 0.5):
        cfg = FitCfg(adapt=False, error_share=share)
        assert takes_to_err(cfg) == (share > FEW_ERRORS)
        for err in (True, False):
            assert takes_to_err(replace(cfg, answers_err=err)) == err


def test_settings_that_are_held_stay() -> None:
    held = FitCfg(adapt=False, error_share=0.07)
    model, _ = fit_reward(answered(60, seed=0), held, seed=0, measured=False)
    assert model.provenance.cfg == held
    again, _ = fit_reward(
        answered(60, seed=0), model.provenance.cfg, seed=0, measured=False
    )
    assert torch.equal(again.scorer.weights, model.scorer.weights)  # type: ignore[union-attr]


def test_the_evidence_is_the_integral_over_the_weight() -> None:
    """One descriptor, so that the integral can be summed on a grid."""
    cfg = replace(FitCfg(), error_share=0.1, tie_threshold=0.0)
    prepared = prepare(answered(30, seed=1), cfg)
    pairs, inputs = prepared.standardised, prepared.clips.differences.inputs[:, :1]
    precision = 1.0
    weights = torch.linspace(-8.0, 8.0, 4001, dtype=torch.float64)[:, None]
    leads = weights @ inputs.mT + pairs.fall_lead.double()
    log_joint = (
        pairs.log_likelihood(leads, cfg).sum(-1)
        - precision / 2 * weights[:, 0].square()
        + 0.5 * np.log(precision / (2 * np.pi))
    )
    summed = float(torch.logsumexp(log_joint, 0)) + np.log(16.0 / 4000)
    assert evidence(inputs, pairs, cfg, precision) == pytest.approx(summed, abs=0.1)


def test_opinions_about_what_robots_are_told_are_strong_and_of_one_piece() -> None:
    factor = prior_factor(LinearCfg(told_most=True), len(DESCRIPTOR_NAMES))
    covariance = factor @ factor.mT
    deviations = covariance.diagonal().sqrt()
    correlation = covariance / torch.outer(deviations, deviations)
    told = named(TOLD)
    assert deviations[told].tolist() == pytest.approx([2.0] * len(TOLD))
    assert deviations[named(EFFORT)].tolist() == pytest.approx([0.5] * len(EFFORT))
    assert deviations[named(FEET)].tolist() == pytest.approx([1 / 3] * len(FEET))
    rest = ~(told | named(EFFORT) | named(FEET))
    assert (deviations[rest] == 1.0).all()
    apart = correlation - torch.eye(len(correlation))
    together = torch.outer(told, told) & ~torch.eye(len(told), dtype=torch.bool)
    assert apart[together].tolist() == pytest.approx([0.8] * together.sum())
    assert apart[~together].abs().max() < 1e-9
    assert torch.equal(
        prior_factor(LinearCfg(), len(told)), torch.eye(len(told)).double()
    )


def test_less_is_believed_of_feet_only_where_answers_err() -> None:
    """Who agrees with himself is taken at his word."""
    for flipped, expected in ((0.25, True), (0.0, False)):
        pairs = answered(150, seed=3, flipped=flipped)
        most, even = (weights_of(pairs, told_most=most) for most in (True, False))
        assert torch.equal(most, even) != expected
        less = most[named(FEET)].norm() < 0.7 * even[named(FEET)].norm()
        assert less == expected


def test_what_robots_are_told_weighs_most_for_and_against_it() -> None:
    """Of a rater who says the opposite, every weight is the opposite."""
    pairs = answered(150, seed=3, flipped=0.25)
    turned = replace(pairs, target=1 - pairs.target)
    torch.testing.assert_close(
        weights_of(pairs, told_most=True), -weights_of(turned, told_most=True)
    )


def weights_of(pairs: AnsweredPairs, *, told_most: bool) -> torch.Tensor:
    """Mean weight [D] over the members, with nothing expected of any sign."""
    linear = LinearCfg(told_most=told_most, unsteady_logit=0.0)
    cfg = FitCfg(linear=linear, fall_logit=0.0)
    model, _ = fit_reward(pairs, cfg, seed=0, measured=False)
    assert isinstance(model.scorer, LinearScorer)
    return model.scorer.weights.mean(dim=0)
