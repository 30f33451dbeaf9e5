"""What keeps a learned reward from doing harm: caution, and the limit of tracking."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from data.features import FEATURE_DIM, column
from gaitpref.options import Loop
from gaitpref.presets import resolve
from gaitpref.retraining import learned_reward
from gaitpref.rewards import total_reward
from gaitpref.tracking_limit import PRICE, TrackingLimit, limit_beside, tracking_error
from policy.checkpoint import load_policy
from policy.config import EnvCfg
from policy.ppo import PpoCfg
from policy.reward import KnownTermsCfg
from policy.robot import load_robot
from policy.train import TrainCfg, train
from rewardmodel import FitCfg, fit_reward
from rewardmodel.caution import CautiousReward
from rewardmodel.descriptors import DESCRIPTOR_NAMES, names_seen
from rewardmodel.extensions.mlp import MlpScorer
from rewardmodel.extensions.settings import MlpCfg
from rewardmodel.habits import UNSTEADY
from rewardmodel.linear import LinearScorer
from rewardmodel.model import RewardModel
from rewardmodel.normaliser import Normaliser
from rewardmodel.rising import RisingReward
from rewardmodel.sparse import SparseScorer
from rewardmodel.storage import load_reward, save_reward

from .test_rewardmodel_acquisition import model_of
from .test_rewardmodel_fit import answered

STARTS = torch.zeros(1, 1)


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
    model, _ = fit_reward(answered(40, seed=0), FitCfg(kind="linear"), seed=0)
    save_reward(model, tmp_path / "reward")
    scorer = load_reward(tmp_path / "reward").scorer
    assert isinstance(scorer, LinearScorer)
    assert isinstance(model.scorer, LinearScorer)
    assert torch.equal(scorer.expected, model.scorer.expected)
    names = {DESCRIPTOR_NAMES[i] for i in scorer.expected.nonzero().flatten()}
    assert names <= set(UNSTEADY)
    assert names
    assert (scorer.expected <= 0.0).all()


def test_of_other_models_the_spread_of_a_step_is_taken_off() -> None:
    linear, scorer = (
        quarrel(),
        MlpScorer(len(DESCRIPTOR_NAMES), MlpCfg(num_members=3, hidden_size=8)),
    )
    scorer.initialise(torch.Generator().manual_seed(0))
    model = RewardModel(linear.normaliser, scorer, linear.provenance)
    asked = row(speed=2.0, height=0.5)
    mean, spread = model(asked, STARTS), model.spread(asked, STARTS)
    assert spread.item() > 0.0
    for caution in (0.0, 1.0, -2.0):
        paid = CautiousReward(model, caution)(asked, STARTS)
        torch.testing.assert_close(paid, mean - caution * spread)


@pytest.mark.parametrize(
    ("share", "caution"),
    [(0.0, 0.0), (0.1, 0.0), (0.15, 0.5), (0.2, 1.0), (0.4, 1.0)],
)
def test_caution_sets_in_where_answers_turned_out_wrong(
    share: float, caution: float
) -> None:
    model = finding(quarrel(), share)
    assert CautiousReward.suited(model, 1.0).caution == pytest.approx(caution)


@pytest.mark.parametrize(("share", "paid"), [(0.1, 2.0 * 3.0 - 2.0), (0.2, -2.0)])
def test_effort_is_not_paid_for_where_answers_err(share: float, paid: float) -> None:
    """Both members like power and dislike torque."""
    weights = {"power": 2.0, "torque_sq": -2.0, "forward_speed": 1.0}
    model = finding(model_of(weights, weights), share)
    working = row(speed=0.0, height=0.0)
    working[..., column("joint_torque").start] = 1.0
    working[..., column("joint_vel").start] = 3.0
    reward = CautiousReward.suited(model, 1.0)
    assert reward(working, STARTS).item() == pytest.approx(paid, abs=1e-4)
    hurried = reward(row(speed=1.0, height=0.0), STARTS)
    assert hurried.item() == pytest.approx(1.0, abs=1e-4)
    plain = CautiousReward.suited(model, 0.0)(working, STARTS)
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


@pytest.mark.parametrize(("share", "sure"), [(0.02, 2.0), (0.1, 2.0), (0.3, 0.0)])
def test_who_errs_is_met_with_caution_and_who_does_not_pays_where_sure(
    share: float, sure: float
) -> None:
    model = finding(quarrel(), share)
    reward = CautiousReward.suited(model, 1.0, sure=2.0)
    assert reward.sure == sure
    assert (reward.caution == 0.0) == (reward.sure > 0.0) == reward.pays_effort
    network = RewardModel(
        model.normaliser,
        MlpScorer(25, MlpCfg(num_members=3, hidden_size=8)),
        model.provenance,
    )
    assert CautiousReward.suited(network, 1.0, sure=2.0).sure == 0.0


def test_the_first_retraining_from_scratch_pays_all_and_styles_always_do() -> None:
    model, rounds = finding(quarrel(), 0.02), (1, 2, 3)
    scratch = resolve(Loop(run=Path("unused"), base="none"))
    style = resolve(Loop(run=Path("unused"), base="task"))
    for cfg, expected in (
        (scratch, [0.0, 2.0, 2.0]),
        (style, [0.0, 0.0, 0.0]),
        (replace(scratch, sure=0.0), [0.0, 0.0, 0.0]),
    ):
        paid = [learned_reward(cfg, n, model, judged=True) for n in rounds]
        assert [r.sure for r in paid if isinstance(r, CautiousReward)] == expected


def curves_of(model: RewardModel, cfg: FitCfg) -> RewardModel:
    """A sum of curves without an opinion, of the same provenance."""
    provenance = replace(model.provenance, cfg=cfg)
    scorer = SparseScorer(2, len(names_seen("legs")))
    return RewardModel(Normaliser(len(names_seen("legs"))), scorer, provenance)


def test_curves_go_on_where_somebody_is_asked_afterwards() -> None:
    """In any retraining of a style, and not where nobody is."""
    model = curves_of(quarrel(), FitCfg(kind="sparse"))
    cfg = resolve(Loop(run=Path("unused"), preset="quick"))
    for round in (1, cfg.rounds):
        found = [
            type(learned_reward(cfg, round, model, judged=judged))
            for judged in (True, False)
        ]
        assert found == [RisingReward, CautiousReward]
    plain = learned_reward(replace(cfg, beyond=0.0), 1, model, judged=True)
    assert isinstance(plain, CautiousReward)


def test_a_sum_of_few_curves_is_paid_in_full() -> None:
    """However wrong the answers: its doubt is greatest about the habit wanted most."""
    model = curves_of(quarrel(), FitCfg(kind="sparse", error_share=0.4))
    for sure in (0.0, 2.0):
        reward = CautiousReward.suited(model, 1.0, sure=sure)
        assert (reward.caution, reward.sure) == (0.0, 0.0)


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
    one, two = (limit_beside(base, slack_m_s=s, seed=1).error_m_s for s in (0.0, 0.1))
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
