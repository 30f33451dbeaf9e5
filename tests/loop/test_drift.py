"""The loop does not fool itself: answers that do not agree, and a reward to exploit."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from data.datasets.dataset import Dataset
from gaitpref.cli.main import main
from gaitpref.loop.people import People
from gaitpref.loop.policy_stage import policy_stage
from gaitpref.loop.run import run_loop
from gaitpref.loop.run_dir import Round
from gaitpref.method.budget import FrontLoaded
from gaitpref.method.context import RoundContext
from gaitpref.raters.criteria import load_criterion
from gaitpref.raters.criterion_scores import criterion_context, score_of_criterion
from gaitpref.raters.rater_cfg import RaterCfg
from gaitpref.raters.simulated import answer_pairs
from gaitpref.training.total_reward import total_reward
from policy.env.env_cfg import EnvCfg
from policy.env.feature_row import OBS_DIM
from policy.env.known_terms import KnownTermsCfg
from policy.robots.robot import load_robot
from policy.rollouts.evaluate import rollout_features, summarise
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg
from policy.training.checkpoint import holding_home, load_policy
from policy.training.ppo import PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from rewardmodel import AnsweredPairs, FitCfg, RewardModel, fit_reward, load_pairs
from rewardmodel.asking.clip_questions import ClipCfg, ask
from rewardmodel.descriptors.table import DESCRIPTOR_NAMES
from rewardmodel.linear.linear import LinearScorer
from rewardmodel.models.kinds import prepare
from rewardmodel.trust.alarms import alarms, reach
from tests.helpers.small_loop import small_cfg


def test_answers_that_do_not_agree_train_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Answers at random: the loop says so, lets the robot stand, and asks again;
    `gaitpref trust` says the same.

    They are two hundred, most of them asked at first: of a hundred the right ones are
    often many enough to agree.
    """
    small = small_cfg(seed=1)
    cfg = replace(
        small,
        method=replace(
            small.method,
            budget=FrontLoaded(first_share=0.74),
        ),
        steps=replace(small.steps, base=0),
        labels=200,
        record=RecordCfg(episodes=90, episode_s=2.0),
        simulated=RaterCfg(mistakes=0.5),
    )
    run = tmp_path / "run"
    run_loop(run, cfg)
    told = " ".join("".join(capsys.readouterr()).split())
    assert "the answers do not agree with one another" in told
    assert "the robot stands still, because the answers do not agree" in told
    assert "no round is left" in told
    first, second = (load_policy(run / f"rounds/0{n}/policy/policy.pt") for n in (0, 1))
    obs = torch.randn(5, OBS_DIM, generator=torch.Generator().manual_seed(0))
    # Nobody has trained it, so what chance put into it is not acted out either.
    assert first(obs).abs().max() > 0.0
    assert (second(obs) == 0.0).all()
    assert (second.info, second.std.tolist()) == (first.info, first.std.tolist())
    with Dataset.open(run / "dataset").answers() as store:
        # Nothing new was trained, so there is nothing to judge at the end.
        assert store.count() < 200
        assert store.pairs(round=2) == []
    report = json.loads((run / "rounds/00/report.json").read_text())
    assert "do not agree" in report["trust"]["alarm"]
    assert not report["trust"]["deserves_training"]
    assert "do not agree" in (run / "report/index.html").read_text()

    assert main(["method", "--run", str(run)]) == 0
    decided = capsys.readouterr().out
    assert "round 1: nothing was trained, because the answers do not agree" in decided

    on = ["--reward", str(run / "rounds/01/reward"), "--dataset", str(run / "dataset")]
    assert main(["trust", *on, "--json"]) == 0
    trust = json.loads(capsys.readouterr().out)
    assert trust["accuracy"]["interval"][0] <= 0.5
    assert "do not agree" in trust["alarm"]
    assert trust["answers_are_those_fitted"]


@pytest.mark.parametrize(("steps", "base"), [(1536, "none"), (0, "policy.pt")])
def test_a_policy_that_somebody_has_trained_or_given_stays(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], steps: int, base: str
) -> None:
    """Byte for byte, where the answers do not agree."""
    cfg = replace(small_cfg(), base=base)
    run, robot = tmp_path / "run", load_robot(physics_dt_s=cfg.env.physics_dt_s)
    before, round = Round(run, 0), Round(run, 1)
    start = TrainCfg(steps=steps, env=cfg.env, ppo=cfg.ppo)
    train(before.policy.parent, robot, start)
    before.report.write_text(json.dumps({"trust": {"deserves_training": False}}))
    context = RoundContext(number=1, rounds=cfg.rounds, labels=cfg.labels)
    dataset = Dataset.create(run / "dataset")
    policy_stage(cfg, round, context, robot, dataset, People())
    assert round.policy.read_bytes() == before.policy.read_bytes()
    assert "the policy stays as it was" in " ".join(capsys.readouterr().err.split())


def exploitable(model: RewardModel, pairs: AnsweredPairs) -> RewardModel:
    """The reward with a planted flaw: pulling hard from the home pose is wonderful."""
    assert isinstance(model.scorer, LinearScorer)
    weights = torch.zeros_like(model.scorer.weights)
    weights[:, DESCRIPTOR_NAMES.index("action_sq")] = 1.0
    model.scorer.weights.copy_(weights)
    # Unit deviation on the judged steps, as every fitted reward has.
    return model.calibrate(prepare(pairs, FitCfg()).described)


def test_an_exploited_reward_is_noticed(tmp_path: Path) -> None:
    """The true return falls by a tenth, the learned one rises, and the alarm is raised
    of that policy and not of the one the answers are about."""
    env = EnvCfg()
    robot = load_robot(physics_dt_s=env.physics_dt_s)
    true = load_criterion("task", criterion_context(robot, env))
    ppo = PpoCfg(num_envs=32, hidden_sizes=(32,))
    start = TrainCfg(steps=0, env=env, ppo=ppo, exploration_std=0.1)
    policy = train(tmp_path / "start", robot, start).policy
    # It stands: how long what chance puts into a network stays up, chance decides.
    policy.write_bytes(holding_home(policy))
    dataset = Dataset.create(tmp_path / "set")
    cfg = RecordCfg(episodes=48, episode_s=2.0, noisy_share=1.0)
    dataset.add_episodes(record(policy, cfg, seed=0))
    chosen = ask(
        dataset,
        dataset.entries(),
        ClipCfg(),
        40,
        known=[],
        model=None,
        round_number=0,
        uniform_share=1.0,
        rng=np.random.default_rng(0),
    )
    with dataset.answers() as store:
        store.add_pairs(chosen)
    answer_pairs(dataset, true, rater_id="simulated", seed=0)
    pairs = load_pairs([dataset])
    model = exploitable(fit_reward(pairs, FitCfg(), seed=0)[0], pairs)
    total = total_reward(model, robot, env, known=KnownTermsCfg())
    # Long enough that the flaw is found, whichever clips were judged.
    hack = TrainCfg(steps=60 * 24 * 64, env=env, ppo=replace(ppo, num_envs=64))
    hacked = train(tmp_path / "hack", robot, hack, reward_fn=total, init=policy).policy

    def measured(file: Path) -> tuple[float, float, tuple[str, ...]]:
        """True and learned return without noise, and alarms as if the latter rose."""
        features, lengths = rollout_features(
            load_policy(file), robot, env, episodes=8, seed=0
        )
        true_return, learned = (
            summarise(features, lengths, score, control_dt_s=env.control_dt_s)
            for score in (score_of_criterion(true), model)
        )
        reached = reach(model, pairs, features, lengths)
        told = alarms(None, reached, return_rose=True)
        return true_return.return_mean, learned.return_mean, told

    true_before, learned_before, quiet = measured(policy)
    true_after, learned_after, told = measured(hacked)
    assert true_after < 0.9 * true_before
    assert learned_after > learned_before
    assert any("does what nobody has judged" in reason for reason in told)
    assert not any("nobody has judged" in reason for reason in quiet)
