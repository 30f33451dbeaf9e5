"""The posterior over one to three habits: what it learns, and what it asks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from rewardmodel import FitCfg, fit_reward, load_reward, save_reward
from rewardmodel.acquisition.information import information
from rewardmodel.errors import RewardError
from rewardmodel.linear.noise_level import FEW_ERRORS
from rewardmodel.models.kinds import prepare
from rewardmodel.opinions.occupancy import NODES, along, occupancy
from rewardmodel.opinions.opinions import SHAPES, Opinions, habit_of
from rewardmodel.opinions.ranges import HABITS, TABLE
from rewardmodel.posterior.curve_scorer import PosteriorScorer
from rewardmodel.posterior.fit_posterior import answers_seen, probably_chance
from rewardmodel.posterior.hypotheses import Hypotheses, Prior, drawn
from rewardmodel.posterior.sampler import Answers, sampled
from rewardmodel.trust.alarms import MOST_BY_CHANCE
from tests.rewardmodel.test_curves import (
    Taste,
    apart,
    asked,
    best_height,
    best_rate,
    front_feet,
    one_foot,
)
from tests.rewardmodel.test_fit import accuracy

POSTERIOR = FitCfg(kind="posterior", tie_threshold=0.3)


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def habits_of(scorer: PosteriorScorer) -> dict[str, float]:
    """Share of the particles that have an opinion about a habit."""
    habit = habit_of(scorer.opinion)
    return {
        name: float(((habit == i) & (scorer.weight != 0)).any(dim=1).float().mean())
        for i, name in enumerate(HABITS)
    }


def likelihood_of(
    wishes: Hypotheses, opinions: Opinions, answers: Answers
) -> torch.Tensor:
    """Logarithm [N] of how probable the answers are, some wishes at a time."""
    parts = (wishes[rows] for rows in torch.arange(len(wishes)).split(5000))
    return torch.cat(
        [
            answers.log_likelihood(
                part.leads(opinions, answers.difference), part.error_share
            )
            for part in parts
        ]
    )


@pytest.mark.parametrize(
    ("taste", "answers", "named", "least", "by_weights"),
    [
        (one_foot, 40, {"foot_height_RL"}, 0.95, 0.75),
        (apart, 40, {"side_support"}, 0.95, 0.65),
        (front_feet, 40, {"foot_height_front", "foot_height_rear"}, 0.9, 0.75),
        (best_height, 40, {"height"}, 0.95, 0.7),
        (best_rate, 60, {"stride_rate"}, 0.75, 0.65),
    ],
)
def test_few_answers_name_the_one_thing_wanted(
    taste: Taste, answers: int, named: set[str], least: float, by_weights: float
) -> None:
    """Judged on fresh pairs, beside the linear model, which cannot say it."""
    pairs, fresh = asked(taste, answers, seed=0), asked(taste, 300, seed=99)
    model, report = fit_reward(pairs, POSTERIOR, seed=0)
    assert accuracy(model, fresh) > least
    assert isinstance(model.scorer, PosteriorScorer)
    shares = habits_of(model.scorer)
    assert max(shares[name] for name in named) > 0.5
    assert report.held_out_accuracy is not None
    assert report.held_out_accuracy > least - 0.15
    linear, _ = fit_reward(pairs, FitCfg(), seed=0, measured=False)
    assert accuracy(linear, fresh) < by_weights


@pytest.mark.parametrize("flipped", [0.1, 0.5])
def test_random_answers_are_told_from_those_that_mean_something(flipped: float) -> None:
    """Of the former some look meant by chance."""
    found = [
        probably_chance(
            prepare(asked(apart, 40, seed=seed, flipped=flipped), POSTERIOR),
            POSTERIOR,
            seed=0,
        )
        for seed in range(3)
    ]
    meant = [chance <= MOST_BY_CHANCE for chance in found]
    assert sum(meant) == 3 if flipped == 0.1 else sum(meant) <= 1


@pytest.mark.parametrize(("flipped", "err"), [(0.0, False), (0.3, True)])
def test_it_tells_the_errors_of_raters_from_its_own(flipped: float, err: bool) -> None:
    """What no weighted sum says is no error to it; what is one is."""
    pairs = asked(one_foot, 100, seed=0, flipped=flipped)
    model, _ = fit_reward(pairs, POSTERIOR, seed=0, measured=False)
    assert (model.provenance.cfg.error_share > FEW_ERRORS) == err


def test_the_mean_of_a_curve_is_found_from_where_a_clip_was() -> None:
    rng = generator()
    places = 2.6 * torch.rand(3, 20, len(HABITS), generator=rng) - 0.8
    scored = torch.rand(3, 20, generator=rng) < 0.7
    table = torch.randn(2, len(HABITS), len(NODES), generator=rng)
    found = torch.einsum("bgk,mgk->mb", occupancy(places, scored), table)
    steps = along(table, places)
    expected = (steps * scored).sum(dim=2) / scored.sum(dim=1)
    assert torch.allclose(found, expected, atol=1e-4)


def test_particles_agree_with_the_prior_reweighted_by_brute_force() -> None:
    """Marginals of the sampler, beside a hundred thousand draws of the prior, each
    weighted by the likelihood of all answers."""
    pairs = asked(best_height, 6, seed=3)
    prepared = prepare(pairs, POSTERIOR)
    pool = prepared.clips.pool
    assert pool
    answers = answers_seen(prepared.standardised, pool, POSTERIOR)
    prior = drawn(pool.opinions, Prior(), 100_000, generator(1))
    log_weight = likelihood_of(prior, pool.opinions, answers)
    weight = log_weight.softmax(dim=0)
    assert float(1 / weight.square().sum()) > 500
    found = sampled(pool.opinions, 0.1, answers, 4000, generator(2)).found

    def about(of: Hypotheses, name: str) -> torch.Tensor:
        index = HABITS.index(name)
        return ((habit_of(of.opinion) == index) & (of.weight > 0)).any(dim=1).float()

    for name in ("height", "foot_height_RL", "stride_rate", "power"):
        exact = float((weight * about(prior, name)).sum())
        assert float(about(found, name).mean()) == pytest.approx(exact, abs=0.05), name
    for of in ("error_share", "sharpness"):
        exact = float((weight * getattr(prior, of).flatten()).sum())
        scale = float(getattr(prior, of).std())
        got = float(getattr(found, of).mean())
        assert abs(got - exact) < 0.15 * scale, of


@pytest.mark.parametrize("why", ["posture", "rhythm"])
def test_what_answers_are_said_to_be_about_is_believed(why: str) -> None:
    """And forgotten where the answers themselves say otherwise; a few wrong ones among
    right ones do no harm."""
    few, many = asked(best_height, 4, seed=3), asked(best_height, 60, seed=3)
    silent, said = (
        fit_reward(replace(few, whys=whys), POSTERIOR, seed=0, measured=False)[0].scorer
        for whys in ((), (why,) * 4)
    )
    assert isinstance(silent, PosteriorScorer)
    assert isinstance(said, PosteriorScorer)

    def about(scorer: PosteriorScorer) -> float:
        found = habits_of(scorer)
        return sum(found[habit.name] for habit in TABLE if habit.aspect == why)

    assert about(said) > about(silent) + 0.3
    mostly = tuple("feet" if row % 5 == 0 else "posture" for row in range(60))
    scorer = fit_reward(replace(many, whys=mostly), POSTERIOR, seed=0, measured=False)[
        0
    ].scorer
    assert isinstance(scorer, PosteriorScorer)
    assert habits_of(scorer)["height"] > 0.9


def test_reasons_do_not_make_answers_look_random() -> None:
    """Though some are wrong, and none is needed."""
    pairs = asked(apart, 40, seed=3, flipped=0.1)
    whys = tuple("rhythm" if row % 5 < 3 else "effort" for row in range(40))
    for given in ((), whys):
        prepared = prepare(replace(pairs, whys=given), POSTERIOR)
        assert probably_chance(prepared, POSTERIOR, seed=0) < MOST_BY_CHANCE


def test_reasons_are_part_of_what_is_weighed_by_brute_force() -> None:
    """The posterior of answers with reasons, beside the prior, weighted."""
    pairs = asked(best_height, 6, seed=3)
    pairs = replace(pairs, whys=("posture", "", "rhythm", "", "posture", ""))
    prepared = prepare(pairs, POSTERIOR)
    pool = prepared.clips.pool
    assert pool
    answers = answers_seen(prepared.standardised, pool, POSTERIOR)
    prior = drawn(pool.opinions, Prior(), 60_000, generator(1))
    log_weight = likelihood_of(prior, pool.opinions, answers)
    for index, why in ((0, "posture"), (2, "rhythm"), (4, "posture")):
        amount = (
            prior.weight.double()
            * answers.difference[prior.opinion, index].abs().double()
        )
        fits = torch.tensor([habit.aspect == why for habit in TABLE])
        own = fits[habit_of(prior.opinion)]
        share = (amount * own).sum(1) / amount.sum(1).clamp_min(1e-12)
        log_weight += (0.75 * share + 0.25 / 5).log()
    weight = log_weight.softmax(dim=0)
    found = sampled(pool.opinions, 0.1, answers, 4000, generator(2)).found
    for name in ("height", "stride_rate", "power"):
        index = HABITS.index(name)
        has = ((habit_of(prior.opinion) == index) & (prior.weight > 0)).any(dim=1)
        got = ((habit_of(found.opinion) == index) & (found.weight > 0)).any(dim=1)
        exact = float((weight * has).sum())
        assert float(got.float().mean()) == pytest.approx(exact, abs=0.06), name


def test_the_evidence_is_that_of_the_prior_by_brute_force() -> None:
    prepared = prepare(asked(best_height, 8, seed=3), POSTERIOR)
    pool = prepared.clips.pool
    assert pool
    answers = answers_seen(prepared.standardised, pool, POSTERIOR)
    prior = drawn(pool.opinions, Prior(), 50_000, generator(1))
    likely = likelihood_of(prior, pool.opinions, answers)
    exact = float(likely.logsumexp(dim=0)) - np.log(len(likely))
    found = [
        sampled(pool.opinions, 0.1, answers, 2000, generator(seed)).log_evidence
        for seed in range(3)
    ]
    assert np.mean(found) == pytest.approx(exact, abs=0.3)


def test_what_particles_disagree_about_is_paid_less() -> None:
    """A wish that forty answers tell has nearly the deviation of a step's worth, 1; of
    eight that say little of it, a part."""
    deviations = []
    for count in (8, 40):
        pairs = asked(best_height, count, seed=3)
        model, _ = fit_reward(pairs, POSTERIOR, seed=0, measured=False)
        rewards = torch.cat(
            [model.clip_rewards(clips)[0] for clips in (pairs.left, pairs.right)]
        )
        deviations.append(float(rewards.std()))
    few, many = deviations
    assert few < 0.8
    assert 0.8 < many < 1.1


def test_what_is_known_or_nobody_can_tell_is_not_asked() -> None:
    """Particles agree about clips 0 and 1, differ about 2 and 3, and think the same of
    4 and 5 but are random about them."""
    rng = np.random.default_rng(0)
    worth = torch.zeros(400, 6)
    worth[:, 0] = 8.0
    worth[::2, 2] = 8.0
    worth[1::2, 3] = 8.0
    questions = torch.tensor([[0, 1], [2, 3], [4, 5], [1, 4], [3, 5], [0, 2]])
    found = information(worth, torch.full((400,), 0.02), questions, rng)
    assert found.argmax() == 1
    assert found[0] < 0.01
    assert found[2] < 0.01


def test_a_stored_posterior_pays_the_same(tmp_path: Path) -> None:
    pairs = asked(best_rate, 40, seed=0)
    model, _ = fit_reward(pairs, POSTERIOR, seed=0, measured=False)
    save_reward(model, tmp_path / "reward")
    again = load_reward(tmp_path / "reward")
    rows, starts = pairs.left.features.transpose(0, 1), torch.zeros(60, 40)
    assert torch.equal(model(rows, starts), again(rows, starts))
    assert torch.equal(model.spread(rows, starts), again.spread(rows, starts))


@pytest.mark.parametrize("opinion", [-1, len(HABITS) * len(SHAPES)])
def test_an_opinion_that_is_none_is_refused(tmp_path: Path, opinion: int) -> None:
    """A file may say anything."""
    pairs = asked(best_rate, 10, seed=0)
    model, _ = fit_reward(pairs, POSTERIOR, seed=0, measured=False)
    assert isinstance(model.scorer, PosteriorScorer)
    model.scorer.opinion[3, 1] = opinion
    save_reward(model, tmp_path / "reward")
    with pytest.raises(RewardError, match=r"damaged.*opinions must lie in"):
        load_reward(tmp_path / "reward")
