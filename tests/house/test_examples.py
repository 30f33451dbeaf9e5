"""Every example is run, with little of everything, on real physics."""

from __future__ import annotations

import importlib
from dataclasses import replace
from pathlib import Path
from types import FunctionType, ModuleType

import pytest
import torch

import data
import gaitpref
import labeling_ui
import policy
import rewardmodel
from benchmarks import other_trainers
from data import Dataset
from data.errors import GaitprefError
from gaitpref import (
    LoopCfg,
    StepsCfg,
    loop_cfg,
    open_dataset,
    record,
    run_loop,
    score_episode,
)
from policy import EnvCfg, PpoCfg, RecordCfg, TrainCfg, load_policy, load_robot, train
from rewardmodel import load_reward
from tests.helpers.few_evaluated import evaluate_few
from tests.helpers.own_lookers import fewer_feet_down

PACKAGES = (data, gaitpref, labeling_ui, policy, rewardmodel)


def example(name: str) -> ModuleType:
    return importlib.import_module(f"examples.{name}")


@pytest.fixture(scope="module")
def small_policy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A policy of one update."""
    ppo = PpoCfg(num_envs=16, hidden_sizes=(16,))
    cfg = TrainCfg(steps=768, env=EnvCfg(episode_s=2.0), ppo=ppo)
    robot = load_robot(physics_dt_s=cfg.env.physics_dt_s)
    return train(tmp_path_factory.mktemp("policy"), robot, cfg).policy


def tiny(cfg: LoopCfg) -> LoopCfg:
    return replace(
        cfg,
        env=replace(cfg.env, episode_s=2.0),
        rounds=1,
        labels=12,
        steps=StepsCfg(base=768, round=768, last=768),
        evaluation_episodes=4,
        ppo=replace(cfg.ppo, num_envs=16),
        record=RecordCfg(episodes=40, episode_s=2.0),
    )


@pytest.mark.parametrize("name", ["own_criterion", "own_method"])
def test_a_loop_of_ones_own_runs(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    evaluate_few(monkeypatch)
    cfg = tiny(example(name).cfg())
    page = run_loop(tmp_path / "run", cfg)
    assert page.exists()
    assert cfg.criterion in page.read_text()
    trained = sorted((tmp_path / "run").glob("rounds/01/*/policy.pt"))[0]
    assert cfg.method.mirror or not load_policy(trained).info.ppo.mirror


def test_a_rater_of_ones_own_is_fitted_and_trained_on(
    tmp_path: Path, small_policy: Path
) -> None:
    example("own_rater").main(
        small_policy, tmp_path, episodes=40, questions=30, steps=768
    )
    dataset = Dataset.open(tmp_path / "dataset")
    with dataset.answers() as store:
        assert store.unanswered("low") == []
        choices = {given.choice for _, given in store.current_answers()}
    assert {"a", "b"} <= choices
    rows = dataset.features(dataset.entries()[0].sha256)
    paid = score_episode(load_reward(tmp_path / "reward"), rows)
    assert paid.shape == (len(rows),)
    assert (tmp_path / "policy" / "policy.pt").exists()
    # Somebody else fits a reward of their own to what is there.
    example("fit_on_a_data_set").main(tmp_path / "dataset", tmp_path / "other")
    assert load_reward(tmp_path / "other").provenance.answers_sha256


def test_what_is_no_episode_is_not_scored(tmp_path: Path, small_policy: Path) -> None:
    dataset = open_dataset(tmp_path / "set", create=True)
    (entry, *_) = record(small_policy, dataset, episodes=2, episode_s=1.0)
    rows = dataset.features(entry.sha256)
    with pytest.raises(ValueError, match=r"rows must be \[T, 90\], got"):
        score_episode(load_reward, rows[:, :5])  # pyright: ignore[reportArgumentType]


def test_a_criterion_scores_an_episode_by_name_or_as_a_function(
    tmp_path: Path, small_policy: Path
) -> None:
    dataset = open_dataset(tmp_path / "set", create=True)
    (entry, *_) = record(small_policy, dataset, episodes=2, episode_s=1.0)
    rows = dataset.features(entry.sha256)
    own = score_episode(lambda features: features[..., 3] * 2, rows)
    assert own.tolist() == (rows[:, 3] * 2).tolist()
    # The task's score, per second, is what the episode's own rewards are.
    episode = dataset.read(entry.sha256)
    paid = score_episode("task", rows) * episode.meta.control_dt_s
    assert paid[:-1] == pytest.approx(episode.reward[:-1], abs=1e-4)
    with pytest.raises(GaitprefError, match="high_step"):
        score_episode("hihg_step", rows)


def test_a_loop_asks_a_function(tmp_path: Path) -> None:
    """If it may: nobody compared it with people."""
    refused = tiny(loop_cfg(base="none", rater=fewer_feet_down))
    with pytest.raises(GaitprefError, match="was never compared with people"):
        run_loop(tmp_path / "run", refused)
    cfg = tiny(loop_cfg(base="none", rater=fewer_feet_down, unchecked=True))
    page = run_loop(tmp_path / "run", cfg)
    assert "rater program:tests.helpers.own_lookers:fewer_feet_down" in page.read_text()
    with open_dataset(tmp_path / "run" / "dataset").answers() as store:
        assert set(store.raters().values()) == {"model"}
        assert store.count() >= 12
    reward = load_reward(tmp_path / "run" / "rounds" / "00" / "reward")
    # Something was learned of what it said.
    assert (reward.provenance.report.train_accuracy or 0.0) > 0.7
    simulated = replace(cfg, rater="simulated")
    with pytest.raises(GaitprefError, match="started with other settings"):
        run_loop(tmp_path / "run", simulated)
    with pytest.raises(GaitprefError, match="rater is 'simulated', 'human', a func"):
        loop_cfg(rater="nobody")


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.__name__)
def test_what_a_package_says_it_has_is_there_and_told(package: ModuleType) -> None:
    assert package.__all__
    for name in package.__all__:
        found = getattr(package, name)
        if isinstance(found, type | FunctionType):
            assert found.__doc__, name


def test_ppo_in_one_file_trains_and_keeps_its_networks(tmp_path: Path) -> None:
    """A few updates change the policy, and what is kept is it; the benchmark looks at
    it as it acts in the Gymnasium environment."""
    module = example("ppo_in_one_file")
    cfg = module.ExampleCfg(
        steps=192, envs=4, steps_per_env=16, out=tmp_path / "one_file" / "ppo.pt"
    )
    agent = module.train(cfg)
    kept = torch.load(cfg.out, weights_only=True)
    fresh = module.Agent(48, 12)
    assert not torch.equal(kept["log_std"], fresh.log_std)
    obs = torch.ones(1, 48)
    fresh.load_state_dict(kept)
    mean = agent.eval().policy(obs).mean
    assert torch.equal(fresh.eval().policy(obs).mean, mean)
    # Nothing is trained again, or it would have other weights.
    looked = other_trainers.Options(work=tmp_path, quick=True, seed=1)
    actor, steps = other_trainers.one_file(looked)
    assert steps == cfg.steps
    limit = EnvCfg().action_limit
    assert torch.equal(actor(obs), mean.detach() * limit)
    wild = other_trainers.Acting(lambda seen: torch.full((len(seen), 12), -9.0))
    assert (wild(obs) == -limit).all()
