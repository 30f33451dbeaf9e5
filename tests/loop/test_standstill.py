"""A robot is got going on opinions the answers leave room for."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from data.answers.strategy_names import APPROVAL
from data.datasets.dataset import Dataset
from data.features import FEATURE_DIM, column
from gaitpref.loop.loop_cfg import LoopCfg
from gaitpref.loop.people import People
from gaitpref.loop.policy_stage import policy_stage
from gaitpref.loop.run import run_loop
from gaitpref.loop.run_dir import Round
from gaitpref.loop.standstill import seen_standing, standstill_before
from gaitpref.method.context import RoundContext
from gaitpref.method.unstick import Optimism
from policy.env.feature_row import OBS_DIM
from policy.robots.robot import load_robot
from policy.training.checkpoint import load_policy
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from policy.training.training_dir import POLICY_NAME
from rewardmodel.descriptors.normaliser import Normaliser
from rewardmodel.extensions.models.mlp import MlpScorer
from rewardmodel.extensions_cfg import MlpCfg
from rewardmodel.linear.linear import LinearScorer
from rewardmodel.models.model import RewardModel
from rewardmodel.paid.optimism import OptimisticReward
from tests.helpers.small_loop import small_cfg
from tests.rewardmodel.test_acquisition import model_of

STEPS, EPISODES = 7, 3


def motion(seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Rows [T, N, F] of episodes with lengths [N]; behind their ends nothing."""
    lengths = torch.tensor([STEPS, 4, 0])
    rows = torch.randn(
        STEPS, EPISODES, FEATURE_DIM, generator=torch.Generator().manual_seed(seed)
    )
    return rows * (torch.arange(STEPS)[:, None] < lengths)[..., None], lengths


def opinions(kind: str) -> RewardModel:
    """Six members with opinions of all kinds."""
    model = model_of(*({} for _ in range(6)))
    scorer = model.scorer
    if kind == "mlp":
        scorer = MlpScorer(len(model.names), MlpCfg(num_members=6, hidden_size=4))
    with torch.no_grad():
        generator = torch.Generator().manual_seed(0)
        for values in (*scorer.parameters(), *scorer.buffers()):
            values.normal_(generator=generator)
    moved = RewardModel(Normaliser(len(model.names)), scorer, model.provenance)
    moved.reward_mean.fill_(0.3)
    moved.reward_std.fill_(2.0)
    return moved


def mean_over(values: torch.Tensor, lengths: torch.Tensor) -> torch.Tensor:
    """Mean [...] of [..., T, N] over the steps of the episodes."""
    return values[..., torch.arange(STEPS)[:, None] < lengths].mean(dim=-1)


def starts_of(rows: torch.Tensor) -> torch.Tensor:
    return (torch.arange(len(rows)) == 0)[:, None].expand(rows.shape[:2])


@pytest.mark.parametrize("kind", ["linear", "mlp"])
@pytest.mark.parametrize("deviations", [0.0, 1.0, 2.0])
def test_what_is_left_is_paid_less_by_so_many_deviations(
    kind: str, deviations: float
) -> None:
    model = opinions(kind)
    rows, lengths = motion(1)
    starts = starts_of(rows)
    reward = OptimisticReward.leaving(model, rows, lengths, deviations)
    plain = mean_over(model(rows, starts), lengths)
    pay = mean_over(model.members(rows, starts), lengths) / model.reward_std
    expected = plain - deviations * pay.std()
    paid = mean_over(reward(rows, starts), lengths)
    assert paid.item() - reward.lift == pytest.approx(expected.item(), abs=1e-4)


@pytest.mark.parametrize("deviations", [0.0, 1.0, 2.0])
@pytest.mark.parametrize(("centre", "costs"), [(-30.0, False), (30.0, True)])
def test_what_is_left_costs_nothing(
    centre: float, costs: bool, deviations: float
) -> None:
    """It is paid as before, or nothing: who only loses by going on falls at once."""
    model = opinions("linear")
    model.reward_mean.fill_(centre)
    rows, lengths = motion(1)
    reward = OptimisticReward.leaving(model, rows, lengths, deviations)
    plain, paid = (
        mean_over(each(rows, starts_of(rows)), lengths).item()
        for each in (model, reward)
    )
    assert paid == pytest.approx(max(plain, 0.0), abs=1e-4)
    assert (plain < 0.0) == costs


def test_of_a_linear_reward_it_is_the_likeliest_that_pays_so_little() -> None:
    """In closed form, from mean and covariance of the members' weights."""
    model = opinions("linear")
    assert isinstance(model.scorer, LinearScorer)
    rows, lengths = motion(2)
    x = mean_over(model.standardised(rows).movedim(-1, 0), lengths)
    mean, spread = model.scorer.weights.mean(dim=0), torch.cov(model.scorer.weights.mT)
    weights = mean - 2.0 * (spread @ x) / (x @ spread @ x).sqrt()
    other, _ = motion(3)
    expected = (model.standardised(other) @ weights - 0.3) / 2.0
    reward = OptimisticReward.leaving(model, rows, lengths, 2.0)
    paid = reward(other, starts_of(other)) - reward.lift
    assert torch.allclose(paid, expected, atol=1e-3)


def test_where_members_agree_there_is_nothing_to_hope_for() -> None:
    model = model_of({"height": 1.0}, {"height": 1.0})
    rows, lengths = motion(4)
    reward = OptimisticReward.leaving(model, rows, lengths, 2.0)
    starts = starts_of(rows)
    assert torch.allclose(reward(rows, starts) - reward.lift, model(rows, starts))


@pytest.mark.parametrize(("speed", "stands"), [(0.09, True), (0.11, False)])
def test_a_robot_stands_that_is_far_slower_than_it_is_told(
    speed: float, stands: bool
) -> None:
    """Told 0.5 m/s ahead, and creeping sideways; rows behind an end do not count."""
    rows = torch.zeros(STEPS, 2, FEATURE_DIM)
    rows[..., column("command").start] = 0.5
    rows[..., column("base_lin_vel_b").start + 1] = speed
    rows[4:, 1] = 9.0
    lengths = torch.tensor([STEPS, 4])
    found = seen_standing(rows, lengths, still=Optimism().still)
    assert (found is not None) == stands
    assert seen_standing(rows, lengths, still=1.1 * speed / 0.5)
    assert not seen_standing(rows, lengths, still=0.9 * speed / 0.5)
    if found:
        assert str(found) == "0.09 m/s where told 0.50"


class _Killed(Exception):
    pass


def untrained_cfg() -> LoopCfg:
    """A small loop whose first policy is untrained: it surely goes nowhere."""
    cfg = small_cfg()
    return replace(cfg, steps=replace(cfg.steps, base=0), labels=70)


def deciding(cfg: LoopCfg, **decisions: Any) -> LoopCfg:
    """`cfg` with other decisions of the method."""
    return replace(cfg, method=replace(cfg.method, **decisions))


def context(cfg: LoopCfg, number: int, *, noisy: bool = False) -> RoundContext:
    return RoundContext(
        number=number, rounds=cfg.rounds, labels=cfg.labels, noisy=noisy
    )


def killed(*others: object) -> None:
    raise _Killed


def until_it_is_fitted(run: Path, cfg: LoopCfg, patch: pytest.MonkeyPatch) -> None:
    """Run a loop until it has fitted its first reward."""
    with patch.context() as stopping:
        stopping.setattr("gaitpref.loop.run.report_stage", killed)
        with pytest.raises(_Killed):
            run_loop(run, cfg)


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small loop that has fitted its first reward, and not trained on it."""
    run = tmp_path_factory.mktemp("loop") / "run"
    with pytest.MonkeyPatch.context() as patch:
        until_it_is_fitted(run, untrained_cfg(), patch)
    return run


def second_training(run: Path, folder: Path, cfg: LoopCfg) -> Round:
    """The round that trains for the second time, in a copy of `run`, after a first time
    that left the robot as it was."""
    copy = folder / ("hopes" if cfg.method.unstick else "does-not")
    shutil.copytree(run, copy)
    shutil.copytree(copy / "rounds/00", copy / "rounds/01")
    round = Round(copy, 2)
    round.root.mkdir()
    round.before.report.write_text("{}")
    robot = load_robot(physics_dt_s=cfg.env.physics_dt_s)
    dataset = Dataset.open(copy / "dataset")
    policy_stage(cfg, round, context(cfg, 2), robot, dataset, People())
    return round


def test_a_robot_that_still_stands_is_got_going(
    asked: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It says so, leaves word beside the policy, and nobody is to judge that."""
    cfg = replace(small_cfg(), rounds=3)
    plain = second_training(asked, tmp_path, deciding(cfg, unstick=None))
    assert not plain.standstill.exists()
    assert "goes nowhere" not in capsys.readouterr().err
    hoped = second_training(asked, tmp_path, cfg)
    assert hoped.policy.read_bytes() != plain.policy.read_bytes()
    told = " ".join(capsys.readouterr().err.split())
    assert "the robot goes nowhere (" in told
    found = json.loads(hoped.standstill.read_text())
    assert 0.0 <= found["speed_m_s"] < 0.2 * found["told_m_s"]


def test_not_at_first_nor_at_the_end_nor_of_a_style(
    asked: Path, tmp_path: Path
) -> None:
    """The first reward has not been tried yet; nor where nothing is hoped for."""
    run = tmp_path / "run"
    shutil.copytree(asked / "rounds/00/policy", run / "rounds/00/policy")
    shutil.copytree(asked / "rounds/00/policy", run / "rounds/01/policy")
    cfg, short = replace(small_cfg(), rounds=3), small_cfg()
    style, hopeless = small_cfg(base="task"), deciding(cfg, unstick=None)
    second = Round(run, 2)
    assert standstill_before(cfg, Round(run, 1), context(cfg, 1)) is None
    assert standstill_before(cfg, Round(run, 1), context(cfg, 1, noisy=True)) is None
    assert standstill_before(cfg, second, context(cfg, 2))
    assert standstill_before(cfg, second, context(cfg, 2, noisy=True))
    assert standstill_before(short, second, context(short, 2)) is None
    style = replace(style, rounds=3)
    assert standstill_before(style, second, context(style, 2)) is None
    assert standstill_before(hopeless, second, context(cfg, 2)) is None


@pytest.mark.parametrize("shown", [True, False])
def test_a_policy_to_be_seen_is_not_kept_where_answers_do_not_agree(
    tmp_path: Path, shown: bool
) -> None:
    """It need not please, so the robot rather stands. Any other stays."""
    cfg = small_cfg()
    before, last = Round(tmp_path / "run", 1), Round(tmp_path / "run", 2)
    robot = load_robot(physics_dt_s=cfg.env.physics_dt_s)
    train(before.policy.parent, robot, TrainCfg(steps=768, env=cfg.env, ppo=cfg.ppo))
    if shown:
        before.standstill.write_text("{}")
    before.report.write_text(json.dumps({"trust": {"deserves_training": False}}))
    dataset = Dataset.create(tmp_path / "set")
    policy_stage(cfg, last, context(cfg, 2), robot, dataset, People())
    obs = torch.randn(5, OBS_DIM, generator=torch.Generator().manual_seed(0))
    # It waits for those who judge the last policy.
    found = last.candidate / POLICY_NAME
    assert bool((load_policy(found)(obs) == 0.0).all()) == shown
    same = found.read_bytes() == before.policy.read_bytes()
    assert same == (not shown)


def test_who_leaves_a_standstill_is_not_judged_and_the_page_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of answers that err; the first reward here finds that they hardly do."""
    run = tmp_path / "run"
    cfg = replace(untrained_cfg(), rounds=3)
    until_it_is_fitted(run, cfg, monkeypatch)
    decided = Round(run, 0).decided
    found = json.loads(decided.read_text())
    assert not found["noisy"]
    decided.write_text(json.dumps({**found, "noisy": True}))
    run_loop(run, cfg)
    rounds = [Round(run, number) for number in range(4)]
    left = [round.number for round in rounds if round.standstill.exists()]
    assert left == [2]
    for round in rounds:
        report = json.loads(round.report.read_text())
        assert ("standstill" in report) == (round.number in left)
    with Dataset.open(run / "dataset").answers() as store:
        judged = {pair.round for pair in store.pairs() if pair.strategy == APPROVAL}
    assert 3 in judged
    assert not judged & set(left)
    assert "the robot went nowhere" in (run / "report/index.html").read_text()
