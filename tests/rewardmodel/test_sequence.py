"""Models that look back: rhythms, starts of episodes, and one interface for all."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from data.features import column
from gaitpref.adapters.step_reward import StepReward
from rewardmodel import (
    AnsweredPairs,
    FitCfg,
    RewardError,
    RewardModel,
    fit_reward,
    load_reward,
    save_reward,
)
from rewardmodel.answers.clip_batch import pad_clips
from rewardmodel.cfg import KindName, PosteriorCfg
from rewardmodel.explain.attribution import explain
from rewardmodel.extensions_cfg import HistoryCfg, MlpCfg, RawCfg, TransformerCfg
from rewardmodel.posterior.curve_scorer import PosteriorScorer
from tests.rewardmodel.test_curves import asked, best_rate
from tests.rewardmodel.test_fit import answered, gait

STEPS = 60
DT_S = 0.02


def rhythmic(rng: np.random.Generator, frequency_hz: float) -> np.ndarray:
    """Rows in which the speed swings evenly: no step tells how often."""
    rows = gait(rng, STEPS)
    phase = 2 * math.pi * (frequency_hz * DT_S * np.arange(STEPS) + rng.random())
    rows[:, column("base_lin_vel_b")] = 0.0
    rows[:, column("base_lin_vel_b").start] = 0.5 + 0.5 * np.sin(phase)
    return rows


def by_rhythm(count: int, *, seed: int) -> AnsweredPairs:
    """Pairs of which the clip with the quicker rhythm is preferred."""
    rng = np.random.default_rng(seed)
    rhythms = rng.uniform(1.5, 4.5, size=(2, count))
    left, right = (
        pad_clips([rhythmic(rng, frequency) for frequency in of_side])
        for of_side in rhythms
    )
    target = torch.from_numpy(rhythms[0] > rhythms[1]).float()
    return replace(answered(count, seed=seed), left=left, right=right, target=target)


def accuracy(model: RewardModel, pairs: AnsweredPairs) -> float:
    lead = model.leads(pairs.left, pairs.right).mean(dim=0)
    return ((lead > 0) == (pairs.target > 0.5)).float().mean().item()


@pytest.mark.parametrize(
    ("kind", "learns"),
    [("linear", False), ("gp", False), ("mlp", False), ("history", True)],
)
def test_a_rhythm_is_learned_by_looking_back_alone(
    kind: KindName, learns: bool
) -> None:
    """Three hundred answers by the quicker rhythm, judged on fresh pairs."""
    pairs, fresh = by_rhythm(300, seed=0), by_rhythm(200, seed=99)
    model, _ = fit_reward(pairs, FitCfg(kind=kind), seed=0, measured=False)
    found = accuracy(model, fresh)
    assert found > 0.8 if learns else found < 0.65, found


LOOKING_BACK = [
    FitCfg(kind="posterior", posterior=PosteriorCfg(num_particles=50)),
    FitCfg(kind="history", models=(HistoryCfg(num_updates=3),)),
    FitCfg(kind="transformer", models=(TransformerCfg(num_updates=3),)),
]


@pytest.fixture(params=LOOKING_BACK, ids=lambda cfg: cfg.kind)
def model(request: pytest.FixtureRequest) -> RewardModel:
    # A posterior looks back for the rate of steps alone.
    curves = request.param.kind == "posterior"
    pairs = asked(best_rate, 60, seed=1) if curves else by_rhythm(40, seed=1)
    model, _ = fit_reward(pairs, request.param, seed=0, measured=False)
    if isinstance(model.scorer, PosteriorScorer):
        # However often these feet go up and down, it is on the range of its curve.
        model.scorer.ranges.ends[:, -1] = torch.tensor([-20.0, 20.0])
    return model


def rollout(steps: int, seed: int = 5) -> torch.Tensor:
    """Rows [T, 3, F] of three environments."""
    rng = np.random.default_rng(seed)
    return torch.tensor(np.stack([gait(rng, steps) for _ in range(3)], axis=1))


def test_a_step_is_what_its_history_says_and_no_more(model: RewardModel) -> None:
    """The last `history_steps` rows give the same reward as the whole rollout, so that
    training, which keeps as many, pays what a clip would be paid."""
    rows = rollout(70)
    starts = torch.zeros(70, 3, dtype=torch.bool)
    whole = model(rows, starts)
    kept = model.history_steps + 1
    newest = model(rows[-kept:], starts[-kept:])
    assert torch.allclose(whole[-1], newest[-1], atol=1e-5)
    shorter = model(rows[3 - kept :], starts[3 - kept :])
    assert not torch.allclose(whole[-1], shorter[-1], atol=1e-5)
    paid = StepReward(model)
    one_by_one = torch.stack([paid(r, s) for r, s in zip(rows, starts, strict=True)])
    assert torch.allclose(whole, one_by_one, atol=1e-5)


def test_nobody_looks_across_a_reset(model: RewardModel) -> None:
    """What an environment did before its episode began changes nothing after it."""
    rows = rollout(40)
    other = rows.clone()
    other[:20, 1] = rollout(20, seed=7)[:, 1]
    starts = torch.zeros(40, 3, dtype=torch.bool)
    starts[20, 1] = True
    assert torch.allclose(model(rows, starts)[20:], model(other, starts)[20:])
    unmarked = torch.zeros_like(starts)
    assert not torch.allclose(model(rows, unmarked)[20:], model(other, unmarked)[20:])


def test_it_comes_back_from_disk_and_refuses_other_names(
    model: RewardModel, tmp_path: Path
) -> None:
    rows, starts = rollout(30), torch.zeros(30, 3, dtype=torch.bool)
    save_reward(model, tmp_path / "reward")
    loaded = load_reward(tmp_path / "reward")
    assert torch.equal(loaded(rows, starts), model(rows, starts))
    assert loaded.history_steps == model.history_steps > 1
    facts = tmp_path / "reward/reward.json"
    facts.write_text(facts.read_text().replace("contact_FR", "contact_LF"))
    with pytest.raises(RewardError, match="lacks: contact_FR; it has besides: contact"):
        load_reward(tmp_path / "reward")


def test_habits_are_shared_by_occlusion(model: RewardModel) -> None:
    rows = rollout(30)[:, 0].numpy()
    shown = explain(model, pad_clips([rows]))
    assert shown.method == "occlusion"
    assert np.isfinite(shown.shares).all()
    with pytest.raises(RewardError, match="--method occlusion"):
        explain(model, pad_clips([rows]), method="gradients")


@pytest.mark.slow
def test_auto_looks_back_where_the_answers_speak_for_it() -> None:
    """Held-out answers about a rhythm choose `history`, and let a transformer try."""
    cfg = FitCfg(
        kind="auto",
        models=(MlpCfg(num_updates=1), TransformerCfg(num_updates=1)),
    )
    model, report = fit_reward(by_rhythm(300, seed=0), cfg, seed=0)
    assert model.provenance.cfg.kind == "history"
    assert [kind for kind, _ in report.considered][-1] == "transformer"


def test_auto_tries_no_transformer_where_history_does_not_matter() -> None:
    """A weighted sum of habits needs no history, so that the costly model is spared."""
    cfg = FitCfg(
        kind="auto",
        folds=2,
        models=(MlpCfg(num_updates=1), HistoryCfg(num_updates=1)),
    )
    model, report = fit_reward(answered(80, seed=0), cfg, seed=0)
    assert model.provenance.cfg.kind not in ("history", "transformer")
    assert [kind for kind, _ in report.considered][-1] == "history"


@pytest.mark.parametrize("min_crop", [1.0, 0.7])
def test_networks_on_raw_rows_learn_from_many_answers(min_crop: float) -> None:
    """No habit is named to them: of 150 answers they find more than by chance."""
    cfg = FitCfg(
        kind="raw",
        error_share=0.0,
        tie_threshold=0.0,
        adapt=False,
        models=(RawCfg(hidden_size=64, min_crop=min_crop),),
    )
    model, _ = fit_reward(answered(150, seed=1), cfg, seed=0, measured=False)
    assert accuracy(model, answered(200, seed=2)) > 0.75
    assert len(model.names) == 89
