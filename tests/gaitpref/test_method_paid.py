"""What keeps a learned reward from doing harm: caution, and the limit of tracking."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from data.features import FEATURE_DIM, column
from gaitpref.method.context import RoundContext
from gaitpref.method.method import FROM_SCRATCH, STYLE
from gaitpref.method.paid import AsFitted, SurelyLiked
from gaitpref.method.tracking import TrackingPrice
from gaitpref.training.off_policy_training import paid_by_step
from gaitpref.training.total_reward import total_reward
from gaitpref.training.tracking_limit import TrackingLimit, limit_beside, tracking_error
from policy.env.env_cfg import EnvCfg
from policy.env.known_terms import KnownTermsCfg
from policy.robots.robot import load_robot
from policy.training.checkpoint import load_policy
from policy.training.ppo import PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from rewardmodel import FitCfg, fit_reward
from rewardmodel.descriptors.habits import UNSTEADY
from rewardmodel.descriptors.normaliser import Normaliser
from rewardmodel.descriptors.table import DESCRIPTOR_NAMES, names_seen
from rewardmodel.extensions.models.mlp import MlpScorer
from rewardmodel.extensions_cfg import MlpCfg
from rewardmodel.linear.linear import LinearScorer
from rewardmodel.models.model import RewardModel
from rewardmodel.models.storage import load_reward, save_reward
from rewardmodel.paid.caution import CautiousReward
from rewardmodel.posterior.curve_scorer import PosteriorScorer
from tests.rewardmodel.test_acquisition import model_of
from tests.rewardmodel.test_fit import answered

STARTS = torch.zeros(1, 1)
PRICE = TrackingPrice().price


def context(number: int, *, noisy: bool = False) -> RoundContext:
    return RoundContext(number=number, rounds=3, labels=60, noisy=noisy)


def quarrel() -> RewardModel:
    """Two members: speed is good to both, height to one and bad to the other."""
    speed = {"forward_speed": 1.0}
    return model_of(speed | {"height": 1.0}, speed | {"height": -1.0})


def finding(model: RewardModel, share: float) -> RewardModel:
    """`model`, whose fit found this share of the answers to be random."""
    cfg = replace(FitCfg(), error_share=share)
    model.provenance = replace(model.provenance, cfg=cfg)
    return model


def row(*, speed: float, height: float) -> torch.Tensor:
    """A row [1, 1, F]."""
    features = torch.zeros(1, 1, FEATURE_DIM)
    features[..., column("base_lin_vel_b").start] = speed
    features[..., column("base_height")] = height
    return features


def test_what_the_members_agree_on_is_paid_in_full() -> None:
    model = quarrel()
    for caution in (0.0, 1.0, 3.0):
        paid = CautiousReward(model, caution)(row(speed=2.0, height=0.0), STARTS)
        assert paid.item() == pytest.approx(2.0, abs=1e-5)


def test_a_habit_in_doubt_is_paid_less_and_a_sure_one_is_not() -> None:
    """Members say 1.0 and 0.2 of height: 0.6, whose deviation is 0.5657.

    Of it (0.5657 `caution` / 0.6)^2 is taken; up to its doubt it is nothing, and it
    does not change its sign.
    """
    speed = {"forward_speed": 1.0}
    model = model_of(speed | {"height": 1.0}, speed | {"height": 0.2})
    for caution, height in ((0.0, 0.6), (0.5, 0.4667), (1.0, 0.0667), (1.5, 0.0)):
        reward = CautiousReward(model, caution)
        rising = reward(row(speed=0.0, height=1.0), STARTS)
        running = reward(row(speed=1.0, height=0.0), STARTS)
        assert rising.item() == pytest.approx(height, abs=1e-4)
        assert running.item() == pytest.approx(1.0, abs=1e-4)


def test_a_habit_in_doubt_is_paid_as_was_expected() -> None:
    """Members say 0.5 and -0.5 of height and nothing of speed; -0.75 and 0 were
    expected: height is 0.75 above that, of which (0.7071 `caution` / 0.75)^2 is
    taken."""
    model = model_of({"height": 0.5}, {"height": -0.5})
    risen = row(speed=0.0, height=1.0)
    assert isinstance(model.scorer, LinearScorer)
    model.scorer.expected[DESCRIPTOR_NAMES.index("height")] = -0.75
    for caution, height in ((0.0, 0.0), (0.5, -0.1667), (1.0, -0.6667), (2.0, -0.75)):
        paid = CautiousReward(model, caution)(risen, STARTS)
        assert paid.item() == pytest.approx(height, abs=1e-4)


def test_what_was_expected_is_kept_with_a_fitted_reward(tmp_path: Path) -> None:
    model, _ = fit_reward(answered(40, seed=0), FitCfg(), seed=0, measured=False)
    save_reward(model, tmp_path / "reward")
    scorer = load_reward(tmp_path / "reward").scorer
    assert isinstance(scorer, LinearScorer)
    assert isinstance(model.scorer, LinearScorer)
    assert torch.equal(scorer.expected, model.scorer.expected)
    names = {DESCRIPTOR_NAMES[i] for i in scorer.expected.nonzero().flatten()}
    assert names <= set(UNSTEADY)
    assert names
    assert (scorer.expected <= 0.0).all()


def test_only_a_linear_reward_has_weights_to_be_careful_with() -> None:
    """Another is refused before anything is trained on it, by its kind."""
    linear, scorer = (
        quarrel(),
        MlpScorer(len(DESCRIPTOR_NAMES), MlpCfg(num_members=3, hidden_size=8)),
    )
    provenance = replace(linear.provenance, cfg=FitCfg(kind="mlp"))
    model = RewardModel(linear.normaliser, scorer, provenance)
    for noisy in (True, False):
        with pytest.raises(TypeError, match=r"only a linear reward .* of kind mlp"):
            SurelyLiked().of(model, context(2, noisy=noisy))


@pytest.mark.parametrize(
    ("noisy", "caution", "expected"),
    [(False, 1.0, 0.0), (True, 1.0, 1.0), (True, 0.5, 0.5), (True, 0.0, 0.0)],
)
def test_caution_sets_in_where_answers_err(
    noisy: bool, caution: float, expected: float
) -> None:
    """In every round, whatever share the newest fit found to be random."""
    paid = SurelyLiked(caution=caution)
    for number in (1, 2, 3):
        for share in (0.0, 0.4):
            model = finding(quarrel(), share)
            reward = paid.of(model, context(number, noisy=noisy))
            assert isinstance(reward, CautiousReward)
            assert reward.caution == expected
            assert reward.pays_effort == (expected == 0.0)


@pytest.mark.parametrize(("noisy", "paid"), [(False, 2.0 * 3.0 - 2.0), (True, -2.0)])
def test_effort_is_not_paid_for_where_answers_err(noisy: bool, paid: float) -> None:
    """Both members like power and dislike torque."""
    weights = {"power": 2.0, "torque_sq": -2.0, "forward_speed": 1.0}
    model = model_of(weights, weights)
    working = row(speed=0.0, height=0.0)
    working[..., column("joint_torque").start] = 1.0
    working[..., column("joint_vel").start] = 3.0
    told = context(1, noisy=noisy)
    reward = SurelyLiked().of(model, told)
    assert reward(working, STARTS).item() == pytest.approx(paid, abs=1e-4)
    hurried = reward(row(speed=1.0, height=0.0), STARTS)
    assert hurried.item() == pytest.approx(1.0, abs=1e-4)
    plain = SurelyLiked(caution=0.0).of(model, told)(working, STARTS)
    assert plain.item() == pytest.approx(4.0, abs=1e-4)


@pytest.mark.parametrize(
    ("sure", "liked"), [(0.0, 0.6), (0.5, 0.4667), (1.0, 0.0667), (2.0, 0.0)]
)
def test_only_what_is_surely_liked_is_paid_and_charges_stay(
    sure: float, liked: float
) -> None:
    """Members say 1.0 and 0.2 of height, -1.0 and -0.2 of speed: deviations of 0.5657
    beside means of 0.6, of which (0.5657 `sure` / 0.6)^2 is taken from the former."""
    model = model_of(
        {"height": 1.0, "forward_speed": -1.0}, {"height": 0.2, "forward_speed": -0.2}
    )
    reward = CautiousReward(model, 0.0, sure=sure)
    rising = reward(row(speed=0.0, height=1.0), STARTS)
    running = reward(row(speed=1.0, height=0.0), STARTS)
    assert rising.item() == pytest.approx(liked, abs=1e-4)
    assert running.item() == pytest.approx(-0.6, abs=1e-4)


@pytest.mark.parametrize(("noisy", "sure"), [(False, 2.0), (True, 0.0)])
def test_who_errs_is_met_with_caution_and_who_does_not_pays_where_sure(
    noisy: bool, sure: float
) -> None:
    reward = SurelyLiked().of(quarrel(), context(2, noisy=noisy))
    assert isinstance(reward, CautiousReward)
    assert reward.sure == sure
    assert (reward.caution == 0.0) == (reward.sure > 0.0) == reward.pays_effort


def test_the_first_retraining_from_scratch_pays_all_and_styles_always_do() -> None:
    model, rounds = quarrel(), (1, 2, 3)
    assert isinstance(FROM_SCRATCH.paid, SurelyLiked)
    for paid, expected in (
        (FROM_SCRATCH.paid, [0.0, 2.0, 2.0]),
        (SurelyLiked(sure=0.0), [0.0, 0.0, 0.0]),
    ):
        found = [paid.of(model, context(n)) for n in rounds]
        assert [r.sure for r in found if isinstance(r, CautiousReward)] == expected
    curves = curves_of(model, FitCfg(kind="posterior"))
    for number in rounds:
        assert STYLE.paid.of(curves, context(number)) is curves


def curves_of(model: RewardModel, cfg: FitCfg) -> RewardModel:
    """A sum of curves without an opinion, of the same provenance."""
    provenance = replace(model.provenance, cfg=cfg)
    scorer = PosteriorScorer(50, 50)
    return RewardModel(Normaliser(len(names_seen("legs"))), scorer, provenance)


def test_a_posterior_is_paid_in_full() -> None:
    """However wrong the answers: what is not sure weighs little in its mean."""
    model = curves_of(quarrel(), FitCfg(kind="posterior", error_share=0.4))
    for noisy in (True, False):
        assert STYLE.paid.of(model, context(2, noisy=noisy)) is model


@pytest.mark.parametrize("noisy", [True, False])
def test_as_it_was_fitted_a_reward_of_any_kind_is_paid(noisy: bool) -> None:
    linear = quarrel()
    for model in (linear, curves_of(linear, FitCfg(kind="posterior"))):
        assert AsFitted().of(model, context(3, noisy=noisy)) is model


def asked_and_done(asked: float, done: float) -> torch.Tensor:
    """Rows [2, 3, F] of robots that go `done` m/s where `asked` is wanted."""
    features = torch.zeros(2, 3, FEATURE_DIM)
    features[..., column("command").start] = asked
    features[..., column("base_lin_vel_b").start] = done
    return features


def test_the_style_yields_where_commands_are_followed_worse() -> None:
    """Within the limit nothing changes; a fifth beyond it, 1/e of the style is left."""
    limit = TrackingLimit(error_m_s=0.1)
    for error, left in ((0.0, 1.0), (0.1, 1.0), (0.12, math.exp(-1)), (0.5, 2e-9)):
        rows = asked_and_done(0.5, 0.5 - error)
        assert tracking_error(rows).mean().item() == pytest.approx(error, abs=1e-6)
        assert limit.share(rows) == pytest.approx(left, abs=1e-5)


def test_beyond_the_limit_errors_cost_and_walking_on_does_not() -> None:
    """The price grows up to a fifth beyond it; only who misses by more pays."""
    limit = TrackingLimit(error_m_s=0.1)
    for error, price in ((0.05, 0.0), (0.11, PRICE / 2), (0.12, PRICE), (0.5, PRICE)):
        rows = asked_and_done(0.5, 0.5 - error)
        assert limit.cost(rows).abs().max() < 1e-5
        rows[:, 0, column("base_lin_vel_b").start] += error / 2
        rows[:, 1, column("base_lin_vel_b").start] -= error / 2
        cost = limit.cost(rows)
        assert cost.mean().abs() < 1e-5
        saved = cost[:, 1] - cost[:, 0]
        assert saved.tolist() == pytest.approx([price * error] * 2, abs=1e-4)


def test_the_walk_does_not_yield() -> None:
    """Beyond the limit, the style is worth less and the task what it was."""
    robot, env = load_robot(physics_dt_s=EnvCfg().physics_dt_s), EnvCfg()

    def style(features: torch.Tensor, starts: torch.Tensor) -> torch.Tensor:
        return torch.ones(features.shape[:2])

    rows = asked_and_done(0.5, 0.38)
    starts = torch.zeros(2, 3)
    free, held = (
        total_reward(
            style,
            robot,
            env,
            known=KnownTermsCfg(),
            keep_task=True,
            tracking_limit=limit,
        ).parts(rows, starts, len(rows))
        for limit in (None, TrackingLimit(error_m_s=0.1))
    )
    assert torch.allclose(held["score"], free["score"] * math.exp(-1))
    assert torch.equal(held["task"], free["task"])


def test_off_policy_the_price_is_left_out_and_this_is_said() -> None:
    """Robots that miss their commands get the whole style, and each step is worth the
    same whatever others did."""
    robot, env = load_robot(physics_dt_s=EnvCfg().physics_dt_s), EnvCfg()

    def style(features: torch.Tensor, starts: torch.Tensor) -> torch.Tensor:
        return torch.ones(features.shape[:2])

    free, held = (
        total_reward(style, robot, env, known=KnownTermsCfg(), tracking_limit=limit)
        for limit in (None, TrackingLimit(error_m_s=0.1))
    )
    rows, starts = asked_and_done(0.5, 0.2), torch.zeros(2, 3, dtype=torch.bool)
    rows[:, 0, column("base_lin_vel_b").start] = 0.4
    said: list[str] = []
    paid = paid_by_step(held, said.append)
    assert paid is not None
    assert not torch.allclose(held(rows, starts), free(rows, starts))
    assert torch.equal(paid(rows, starts), free(rows, starts))
    assert torch.equal(paid(rows[:, :1], starts[:, :1]), paid(rows, starts)[:, :1])
    (line,) = said
    assert "following commands worse costs nothing more" in line
    assert paid_by_step(free, said.append) is free
    assert len(said) == 1


def test_the_limit_is_what_the_base_does_and_a_little_more(tmp_path: Path) -> None:
    """A robot that stands misses every command by its speed."""
    cfg = TrainCfg(steps=192, env=EnvCfg(), ppo=PpoCfg(num_envs=8, hidden_sizes=(8,)))
    robot = load_robot(physics_dt_s=cfg.env.physics_dt_s)
    path = train(tmp_path, robot, cfg).policy
    payload = torch.load(path, weights_only=True)
    for name in ("mlp.2.weight", "mlp.2.bias", "distribution.std_param"):
        payload["actor_state_dict"][name].zero_()
    torch.save(payload, path)
    base = load_policy(path)
    one, two = (
        limit_beside(base, TrackingPrice(slack_m_s=slack_m_s), seed=1).error_m_s
        for slack_m_s in (0.0, 0.1)
    )
    assert two - one == pytest.approx(0.1, abs=1e-6)
    rng, asked = np.random.default_rng(0), EnvCfg().commands
    ranges = asked.forward_m_s, asked.left_m_s
    speeds = np.hypot(*(rng.uniform(*ends, 10_000) for ends in ranges))
    assert one == pytest.approx(speeds.mean(), abs=0.05)


def test_a_limit_is_about_the_rollout_alone() -> None:
    """What a reward looks back at was walked, and paid, before: errors of these steps
    are no part of the mean that others are compared with."""

    def style(features: torch.Tensor, starts: torch.Tensor) -> torch.Tensor:
        return torch.ones(features.shape[:2])

    reward = total_reward(
        style,
        load_robot(physics_dt_s=EnvCfg().physics_dt_s),
        EnvCfg(),
        known=KnownTermsCfg(),
        tracking_limit=TrackingLimit(error_m_s=0.1),
    )
    before, after = asked_and_done(0.5, 0.5), asked_and_done(0.5, 0.3)
    rows, starts = torch.cat([before, after]), torch.zeros(4, 3, dtype=torch.bool)
    alone = reward(after, starts[2:])
    figures = dict(reward.figures)
    assert torch.equal(reward.of_rollout(rows, starts, 2), alone)
    assert reward.figures == figures
    # All err by as much, so nobody pays, and next to nothing is left of the style.
    assert figures["reward/tracking"] == pytest.approx(0.0, abs=1e-6)
    assert figures["reward/score"] == pytest.approx(math.exp(-5), rel=1e-3)
