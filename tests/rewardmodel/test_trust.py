"""Calibration, accuracy and distance, against numbers known beforehand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from data.features import FEATURE_DIM, column
from rewardmodel import FitCfg, fit_reward
from rewardmodel.measures.calibration import calibration, counting, fit_temperature
from rewardmodel.measures.held_out import held_out_predictions
from rewardmodel.models.kinds import prepare
from rewardmodel.models.prediction import as_answered
from rewardmodel.trust.alarms import Reach, alarms, reach
from rewardmodel.trust.held_out_report import Foreseen, accuracy_of, foresee, opinion_of
from rewardmodel.trust.support import PIECE_STEPS, Drift, support_of
from tests.rewardmodel.test_fit import answered, gait


def answers_to(logit: torch.Tensor, seed: int = 0) -> torch.Tensor:
    """Answers drawn with exactly the probabilities of `logit`."""
    rng = torch.Generator().manual_seed(seed)
    return (torch.rand(len(logit), generator=rng) < logit.sigmoid()).float()


def test_the_temperature_undoes_overconfidence() -> None:
    """Leads three times too large are divided by three, and then calibrated."""
    logit = torch.linspace(-2, 2, 2000)
    target = answers_to(logit)
    found = fit_temperature(3 * logit, target, torch.ones(2000))
    assert found == pytest.approx(3.0, rel=0.15)
    before, after = (
        calibration(3 * logit, target),
        calibration(3 * logit / found, target),
    )
    assert before is not None
    assert after is not None
    assert before.ece > 0.1 > 0.04 > after.ece
    assert after.ece < 3 * after.ece_by_chance
    assert after.brier < before.brier


def test_no_answer_is_surer_than_who_gives_it() -> None:
    """Two fifths are random, of clear pairs as of close ones: one temperature makes
    the clear ones too sure and the close ones too doubtful; with the share it is 1."""
    logit = torch.linspace(-6, 6, 4000)
    target = answers_to(as_answered(logit, 0.4))
    alike = torch.ones(4000)
    plain = calibration(logit / fit_temperature(logit, target, alike), target)
    temperature = fit_temperature(logit, target, alike, error_share=0.4)
    found = calibration(as_answered(logit / temperature, 0.4), target)
    assert plain is not None
    assert found is not None
    assert temperature == pytest.approx(1.0, abs=0.15)
    assert found.ece < 0.02 < 0.04 < plain.ece
    assert as_answered(torch.tensor(50.0), 0.4).sigmoid() == pytest.approx(0.8)


def test_answers_without_information_make_it_modest() -> None:
    """Confident nonsense ends up near one half."""
    rng = torch.Generator().manual_seed(0)
    target = torch.randint(2, (200,), generator=rng).float()
    lead = 5 * torch.randn(200, generator=rng)
    calibrated = calibration(
        lead / fit_temperature(lead, target, torch.ones(200)), target
    )
    assert calibrated is not None
    assert max(part.confidence for part in calibrated.bins) < 0.65


def test_hard_questions_do_not_make_it_too_careful_about_others() -> None:
    """Four of five questions are chosen, and harder than the leads say: of these only
    three of four are foreseen. The temperature is that of the others."""
    logit = torch.cat([torch.full((20,), 2.0), torch.full((80,), 2.0)])
    target = torch.ones(100)
    target[:2], target[20:40] = 0.0, 0.0
    at_random = torch.arange(100) < 20
    alike = fit_temperature(logit, target, torch.ones(100))
    counts = counting(at_random, target, erring=False)
    found = fit_temperature(logit, target, counts)
    assert (2.0 / torch.tensor(alike)).sigmoid() < 0.8
    assert (2.0 / torch.tensor(found)).sigmoid() == pytest.approx(0.86, abs=0.03)
    measured = calibration(logit / found, target, counts)
    assert measured is not None
    # 0.1 of those drawn at random; a quarter of the chosen ones, which count a tenth.
    wrong = (20 * 0.1 + 8 * 0.25) / 28
    sure = 1 / (1 + np.exp(-2.0 / found))
    brier = wrong * sure**2 + (1 - wrong) * (1 - sure) ** 2
    assert measured.brier == pytest.approx(brier)


@pytest.mark.parametrize(("drawn", "erring"), [(9, False), (60, True), (0, False)])
def test_all_answers_count_alike_where_few_are_drawn_or_answers_err(
    drawn: int, erring: bool
) -> None:
    at_random = torch.arange(60) < drawn
    assert (counting(at_random, torch.ones(60), erring=erring) == 1.0).all()


def test_ties_are_not_enough_drawn_at_random() -> None:
    target = torch.ones(60)
    target[5:20] = 0.5
    assert (counting(torch.arange(60) < 20, target, erring=False) == 1.0).all()


def test_counts_are_as_good_as_copies() -> None:
    """An answer that counts twice is as good as two."""
    logit = torch.linspace(-2, 2, 40)
    target = answers_to(logit)
    counts = torch.ones(40)
    counts[::3] = 2.0
    copies = torch.arange(40).repeat_interleave(counts.long())
    alike = torch.ones(len(copies))
    temperature = fit_temperature(logit, target, counts)
    assert temperature == fit_temperature(logit[copies], target[copies], alike)
    found = calibration(logit, target, counts)
    copied = calibration(logit[copies], target[copies])
    assert found is not None
    assert copied is not None
    assert found.brier == pytest.approx(copied.brier)


def test_questions_drawn_at_random_are_told_from_chosen_ones() -> None:
    """A quarter of the answers to chosen questions is turned round, as if these were
    too close; those drawn at random say how good the reward is, and how sure it is."""
    pairs = answered(160, seed=0)
    drawn = torch.arange(160) % 4 == 0
    wrong = torch.arange(160) % 4 == 2
    names = tuple("uniform" if own else "disagreement" for own in drawn.tolist())
    pairs = replace(
        pairs,
        strategies=names,
        target=torch.where(wrong, 1 - pairs.target, pairs.target),
    )
    assert pairs.subset(drawn).at_random.all()
    assert not pairs.subset(~drawn).at_random.any()
    # A data set of an earlier version may hold pairs of this strategy.
    assert not replace(pairs, strategies=("again",) * 160).at_random.any()
    cfg = FitCfg(adapt=False, error_share=0.05)
    model, report = fit_reward(pairs, cfg, seed=0)
    assert report.at_random_pairs == 40
    assert report.at_random_accuracy is not None
    assert report.held_out_accuracy is not None
    assert report.at_random_accuracy > report.held_out_accuracy + 0.1
    alike = replace(pairs, strategies=("disagreement",) * 160)
    _, careful = fit_reward(alike, cfg, seed=0)
    assert careful.at_random_accuracy is None
    assert careful.temperature > 1.5 * report.temperature

    found = foresee(model, pairs, seed=0)
    assert found.accuracy is not None
    assert found.at_random is not None
    assert found.at_random.answers == 40
    assert found.at_random.share == report.at_random_accuracy
    assert found.temperature == pytest.approx(report.temperature, rel=1e-3)
    # What is saved makes probabilities of what members quarrel about, too.
    prepared = prepare(pairs, cfg)
    asked, opinion = held_out_predictions(prepared, pairs.episodes, cfg, 0)
    counts = counting(pairs.at_random[asked], pairs.target[asked], erring=False)
    expected = fit_temperature(
        opinion.logit, pairs.target[asked], counts, error_share=cfg.error_share
    )
    assert report.temperature == pytest.approx(expected, rel=1e-3)


def test_weighted_calibration_by_hand() -> None:
    """One bin of 80 %: of the first, which counts three times, it was right."""
    logit = torch.full((4,), np.log(4.0))
    target = torch.tensor([1.0, 0.0, 1.0, 0.0])
    found = calibration(logit, target, torch.tensor([3.0, 1.0, 1.0, 1.0]))
    assert found is not None
    assert found.ece == pytest.approx(0.8 - 4 / 6)
    assert [(part.answers, part.alike) for part in found.bins] == [(4, 3)]
    assert found.bins[0].right == pytest.approx(4 / 6)


def test_calibration_by_hand() -> None:
    """Four answers at 80 %, three of them right: error 0.05, Brier 0.19."""
    lead = torch.full((4,), np.log(4.0))
    found = calibration(lead, torch.tensor([1.0, 1.0, 1.0, 0.0]))
    assert found is not None
    assert found.ece == pytest.approx(0.05)
    assert found.brier == pytest.approx((3 * 0.04 + 0.64) / 4)
    assert [part.answers for part in found.bins] == [4]


def test_ties_are_neither_right_nor_wrong() -> None:
    """And a model without an opinion is half right."""
    lead = torch.tensor([1.0, -1.0, 0.0, 5.0])
    found = accuracy_of(lead, torch.tensor([1.0, 1.0, 0.0, 0.5]))
    assert found is not None
    assert (found.answers, found.share) == (3, 0.5)
    assert accuracy_of(lead, torch.full((4,), 0.5)) is None
    assert calibration(lead, torch.full((4,), 0.5)) is None
    assert fit_temperature(lead, torch.full((4,), 0.5), torch.ones(4)) == 1.0


def test_close_questions_hardly_count() -> None:
    """Ten sure answers foreseen and forty that nobody could foresee; and the other way
    round, where the model is sure of nonsense."""
    close = torch.full((40,), 0.01)
    coin = (torch.arange(40) % 2).float()
    lead, target = torch.cat([torch.ones(10), close]), torch.cat([torch.ones(10), coin])
    accuracy, opinion = accuracy_of(lead, target), opinion_of(lead, target)
    assert accuracy is not None
    assert opinion is not None
    assert accuracy.share == pytest.approx(0.6)
    assert accuracy.says_nothing
    assert opinion.share == pytest.approx(10.2 / 10.4)
    assert opinion.answers == 11
    assert not opinion.says_nothing
    nonsense = opinion_of(lead, torch.cat([coin[:10], coin]))
    assert nonsense is not None
    assert nonsense.says_nothing
    assert opinion_of(torch.zeros(3), torch.ones(3)) is None


@pytest.fixture(scope="module")
def of_sixty() -> Foreseen:
    """What a linear reward foresees of sixty answers."""
    pairs = answered(60, seed=0)
    model, _ = fit_reward(pairs, FitCfg(kind="linear"), seed=0, measured=False)
    return foresee(model, pairs, seed=0)


@pytest.mark.parametrize("sure_is_right", [True, False])
def test_answers_disagree_only_where_it_is_wrong_and_sure(
    sure_is_right: bool, of_sixty: Foreseen
) -> None:
    """Of fifty answers 30 or 25 are foreseen; what counts is whether the ten it is
    sure of are."""
    lead = torch.cat([torch.ones(10), torch.full((40,), 0.01)])
    coin = (torch.arange(50) % 2).float()
    target = torch.cat([torch.ones(10), coin[10:]]) if sure_is_right else coin
    foreseen = replace(
        of_sixty,
        accuracy=accuracy_of(lead, target),
        opinion=opinion_of(lead, target),
    )
    reasons = alarms(foreseen, None)
    assert (reasons == ()) == sure_is_right
    assert all("do not agree" in reason for reason in reasons)


@pytest.mark.parametrize("by_chance", [None, 0.5, 0.025])
def test_answers_that_are_hardly_random_do_agree(
    by_chance: float | None, of_sixty: Foreseen
) -> None:
    """Though none of them is foreseen: the closest are asked."""
    coin = accuracy_of(torch.ones(50), (torch.arange(50) % 2).float())
    foreseen = replace(of_sixty, accuracy=coin, opinion=coin, by_chance=by_chance)
    reasons = alarms(foreseen, None)
    assert bool(reasons) == (by_chance != 0.025)
    told = any("random with probability 0.50" in reason for reason in reasons)
    assert told == (by_chance == 0.5)


@pytest.mark.parametrize("curved", [True, False])
def test_only_a_posterior_is_held_against_chance(curved: bool) -> None:
    """And only where held-out answers say too little of them."""
    random = answered(40, seed=2, flipped=0.5)
    kind = "posterior" if curved else "linear"
    model, _ = fit_reward(random, FitCfg(kind=kind), seed=0, measured=False)
    foreseen = foresee(model, random, seed=0)
    assert foreseen.accuracy is not None
    assert foreseen.accuracy.too_low
    assert (foreseen.by_chance is not None) == curved


@pytest.mark.parametrize(
    ("right", "of", "alarm"), [(0, 4, True), (2, 11, True), (9, 25, False)]
)
def test_newest_answers_alarm_where_it_is_no_chance(
    right: int, of: int, alarm: bool, of_sixty: Foreseen
) -> None:
    target = (torch.arange(of) < right).float()
    foreseen = replace(of_sixty, newest=accuracy_of(torch.ones(of), target))
    reasons = alarms(foreseen, None)
    assert any("newest" in reason for reason in reasons) == alarm


def test_agreeing_answers_raise_no_alarm() -> None:
    """A hundred of them, also when a fifth is wrong."""
    for flipped in (0.0, 0.2):
        pairs = answered(100, seed=1, flipped=flipped)
        model, _ = fit_reward(pairs, FitCfg(), seed=0, measured=False)
        foreseen = foresee(model, pairs, seed=0)
        assert foreseen.answers == 100
        assert foreseen.unseen == 0
        assert alarms(foreseen, None) == ()


def test_answers_at_odds_raise_it() -> None:
    """With 40 % of them wrong, in at least 7 of 8 draws."""
    raised = 0
    for seed in range(8):
        pairs = answered(100, seed=seed, flipped=0.4)
        model, _ = fit_reward(pairs, FitCfg(), seed=0, measured=False)
        raised += any(
            "do not agree" in reason
            for reason in alarms(foresee(model, pairs, seed=0), None)
        )
    assert raised >= 7


def test_few_answers_at_odds_are_no_finding() -> None:
    """Chance alone may look like that."""
    pairs = answered(20, seed=0, flipped=0.5)
    model, _ = fit_reward(pairs, FitCfg(), seed=0, measured=False)
    assert alarms(foresee(model, pairs, seed=0), None) == ()


def test_a_fresh_data_set_is_foreseen_by_the_reward_itself() -> None:
    """None of its episodes was seen, so nothing has to be fitted anew."""
    model, _ = fit_reward(answered(100, seed=0), FitCfg(), seed=0)
    fresh = answered(60, seed=7)
    renamed = tuple((f"new {a}", f"new {b}") for a, b in fresh.episodes)
    foreseen = foresee(model, replace(fresh, episodes=renamed), seed=0)
    assert foreseen.unseen == 60
    assert foreseen.accuracy is not None
    assert foreseen.accuracy.share > 0.75


def test_the_newest_round_is_foreseen_without_its_answers() -> None:
    """Turned round in the newest round, answers are foreseen wrongly, and alarm."""
    pairs = answered(80, seed=1)
    rounds = (0,) * 60 + (1,) * 20
    turned = torch.cat([pairs.target[:60], 1 - pairs.target[60:]])
    for target, bad in ((pairs.target, False), (turned, True)):
        changed = replace(pairs, rounds=rounds, target=target)
        model, _ = fit_reward(changed, FitCfg(), seed=0, measured=False)
        foreseen = foresee(model, changed, seed=0)
        assert foreseen.newest is not None
        assert foreseen.newest.answers == 20
        assert (foreseen.newest.share < 0.5) == bad
        assert any("newest" in r for r in alarms(foreseen, None)) == bad
        assert set(foreseen.by_round) == {"0", "1"}
        assert alarms(foreseen, None, return_rose=False) == ()


def rollouts(scale: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Rows [T, N, F] like those of the clips, their base motion times `scale`."""
    rng = np.random.default_rng(5)
    rows = np.stack([gait(rng, 4 * PIECE_STEPS) for _ in range(20)], axis=1)
    for name in ("base_lin_vel_b", "base_ang_vel_b"):
        rows[..., column(name)] *= scale
    return torch.tensor(rows), torch.full((20,), len(rows))


def test_motion_beyond_what_was_judged_is_far() -> None:
    """The same motion is near, ten times faster is far."""
    pairs = answered(60, seed=0, steps=2 * PIECE_STEPS)
    model, _ = fit_reward(pairs, FitCfg(), seed=0)
    near, far = (reach(model, pairs, *rollouts(scale)) for scale in (1.0, 10.0))
    assert near.drift is not None
    assert far.drift is not None
    assert near.drift.share_far < 0.2
    assert far.drift.share_far > 0.95
    assert far.drift.quantile > near.drift.quantile
    assert far.spread > near.spread
    assert alarms(None, near) == ()


def test_pay_beyond_the_range_of_a_habit_is_extrapolated() -> None:
    """Torques three times what anybody judged are paid, or cost, by what is beyond."""
    pairs = answered(100, seed=0)
    model, _ = fit_reward(pairs, FitCfg(folds=2), seed=0)
    rng = np.random.default_rng(5)
    rows = torch.tensor(np.stack([gait(rng, 48) for _ in range(8)], axis=1))
    valid = torch.ones(rows.shape[:2], dtype=torch.bool)
    usual = support_of(pairs, model).drift(rows, valid)
    rows[..., column("joint_torque")] *= 3
    strained = support_of(pairs, model).drift(rows, valid)
    assert usual is not None
    assert strained is not None
    assert abs(usual.extrapolated) < 0.2
    # The planted taste dislikes torque, and the model has learned so.
    assert strained.extrapolated < -0.5


def test_pieces_that_are_not_whole_say_nothing() -> None:
    """Too short, or cut by a fall or a reset."""
    pairs = answered(20, seed=0, steps=2 * PIECE_STEPS)
    support = support_of(pairs, fit_reward(pairs, FitCfg(), seed=0)[0])
    rows = torch.zeros(PIECE_STEPS, 3, FEATURE_DIM)
    valid = torch.ones(PIECE_STEPS, 3, dtype=torch.bool)
    assert support.drift(rows[:-1], valid[:-1]) is None
    valid[5, :2] = False
    found = support.drift(rows, valid)
    assert found is not None
    assert found.pieces == 1


def test_a_policy_nobody_trained_on_is_no_alarm() -> None:
    """Where the learned return did not rise, drift misleads nobody."""
    far = Reach(drift=Drift(1.0, 1.0, 0.0, 1.5, 10), spread=9.0, spread_judged=1.0)
    assert len(alarms(None, far)) == 2
    assert "nobody has judged" in alarms(None, far)[0]
    assert alarms(None, far, return_rose=False) == ()


def test_leaving_what_was_judged_is_no_alarm_where_it_is_not_paid_for() -> None:
    """A robot that learned to walk is far from clips of one that stood: not a fault."""
    walks = Reach(drift=Drift(1.0, 1.0, 0.0, 0.3, 10), spread=1.0, spread_judged=1.0)
    assert alarms(None, walks) == ()
