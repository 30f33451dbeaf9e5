"""The simulated rater errs, skips and ties as often, and where, it is told to."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from data.answers.answer_records import ASPECTS, Choice
from data.episodes.clips import Clip
from data.errors import GaitprefError
from data.features import FEATURE_DIM, column
from gaitpref.cli.options.options import Answer, Erring, Loop
from gaitpref.cli.shared.loop_arguments import resolve
from gaitpref.cli.shared.rater_arguments import rater_cfg
from gaitpref.loop.run_config import claim, read_config
from gaitpref.method.questions import Questions
from gaitpref.raters.criteria import SequenceCriterion
from gaitpref.raters.error_model import (
    Standards,
    discounted_mean,
    judge,
    said_why,
    standards,
)
from gaitpref.raters.rater_cfg import RaterCfg
from gaitpref.raters.simulated import ClipScores

COUNT = 4000


def pairs(seed: int = 0) -> tuple[np.ndarray, np.ndarray, Standards]:
    """Scores [COUNT, T] of left and right clips, and what a rater compares with."""
    rng = np.random.default_rng(seed)
    # Scores of another unit and level: neither may matter.
    level = -7.0 + 3.0 * rng.normal(size=(2, COUNT, 1))
    scores = level + 0.5 * rng.normal(size=(2, COUNT, 20))
    means = scores.mean(axis=-1)
    known = standards((means[0] - means[1]).tolist(), means.ravel().tolist(), skip=0.0)
    return scores[0], scores[1], known


def said(cfg: RaterCfg, *, skip: float = 0.0) -> tuple[list[Choice], np.ndarray]:
    """What a rater says about all pairs, and the leads [COUNT] in typical leads."""
    left, right, known = pairs()
    if skip:
        every = np.concatenate([left.mean(axis=1), right.mean(axis=1)])
        known = replace(known, dull=standards([1.0], every.tolist(), skip).dull)
    rng = np.random.default_rng(1)
    choices: list[Choice] = [
        judge(a, b, cfg, known, rng) for a, b in zip(left, right, strict=True)
    ]
    return choices, (left.mean(axis=1) - right.mean(axis=1)) / known.typical_lead


def wrong(choices: list[Choice], leads: np.ndarray) -> np.ndarray:
    return np.array(choices) != np.where(leads > 0, "a", "b")


def test_a_perfect_rater_never_errs() -> None:
    assert not wrong(*said(RaterCfg())).any()


def test_mistakes_are_as_many_on_clear_pairs_as_on_close_ones() -> None:
    choices, leads = said(RaterCfg(mistakes=0.2))
    errs = wrong(choices, leads)
    clear = np.abs(leads) > 1
    assert errs.mean() == pytest.approx(0.2, abs=0.02)
    assert errs[clear].mean() == pytest.approx(errs[~clear].mean(), abs=0.04)


@pytest.mark.parametrize(("beta", "share"), [(1.0, 0.30), (3.0, 0.14)])
def test_a_stochastic_rater_errs_mostly_on_close_pairs(
    beta: float, share: float
) -> None:
    """Half of the pairs lead by less than the typical lead: they have the errors."""
    choices, leads = said(RaterCfg(beta=beta))
    errs = wrong(choices, leads)
    close = np.abs(leads) < 1
    assert close.mean() == pytest.approx(0.5, abs=0.01)
    assert errs.mean() == pytest.approx(share, abs=0.03)
    assert errs[close].mean() > 2 * errs[~close].mean()


def test_errors_follow_the_rationality_at_every_lead() -> None:
    """Where the lead is about 1, beta 2 is right with probability 1 / (1 + e^-2)."""
    choices, leads = said(RaterCfg(beta=2.0))
    near = np.abs(np.abs(leads) - 1) < 0.1
    right = 1 - wrong(choices, leads)[near].mean()
    assert right == pytest.approx(1 / (1 + math.exp(-2.0)), abs=0.05)


def test_dull_pairs_are_skipped_and_nothing_else() -> None:
    """Both clips are among the worst 30 % in 9 % of independent pairs."""
    choices, _ = said(RaterCfg(skip=0.3), skip=0.3)
    assert Counter(choices)["skip"] / COUNT == pytest.approx(0.09, abs=0.02)


def test_the_threshold_of_a_skip_is_not_scaled_again() -> None:
    """The same clips seen in a second session have the same standards."""
    scores = np.random.default_rng(0).normal(size=100).tolist()
    once = standards([0.5, -2.0, 1.0], scores, 0.3)
    again = standards([0.5, -2.0, 1.0] * 2, scores * 2, 0.3)
    assert once.typical_lead == again.typical_lead == 1.0
    assert once.dull == pytest.approx(again.dull, abs=0.05)
    assert once.dull == pytest.approx(np.quantile(scores, 0.3))


def test_ties_are_exactly_the_close_pairs() -> None:
    """A tie overrides mistakes and chance: "equal" says nothing about either clip."""
    choices, leads = said(RaterCfg(beta=1.0, mistakes=0.3, equal=0.4))
    ties = np.array([choice == "equal" for choice in choices])
    assert np.array_equal(ties, np.abs(leads) < 0.4)


def test_a_myopic_rater_remembers_the_end() -> None:
    """A clip that ends better beats one that was better for longer."""
    known = Standards(1.0, -math.inf)
    early, late = np.r_[np.ones(15), np.zeros(5)], np.r_[np.zeros(15), np.ones(5)]
    rng = np.random.default_rng(0)
    assert judge(early, late, RaterCfg(), known, rng) == "a"
    assert judge(early, late, RaterCfg(gamma=0.8), known, rng) == "b"
    assert discounted_mean(np.array([1.0, 3.0]), 0.5) == pytest.approx(3.5 / 1.5)
    assert discounted_mean(np.full(7, 2.0), 0.9) == pytest.approx(2.0)


def test_what_a_rater_says_to_be_the_reason_is_right_in_its_share() -> None:
    """Wrong reasons are any of the other four; a preference is the same with them."""
    rng = np.random.default_rng(0)
    said = Counter(said_why(RaterCfg(why="feet"), rng) for _ in range(4000))
    assert said["feet"] / 4000 == pytest.approx(0.8, abs=0.03)
    others = [said[aspect] for aspect in ASPECTS if aspect != "feet"]
    assert min(others) > 0.6 * max(others) > 0
    assert said_why(RaterCfg(), rng) == ""


def test_equal_clips_and_equal_pairs() -> None:
    """No lead anywhere: equal to a perfect rater, a coin toss to a stochastic one."""
    same = np.ones(5)
    known = standards([0.0, 0.0], [1.0, 1.0], 0.0)
    rng = np.random.default_rng(0)
    assert judge(same, same, RaterCfg(), known, rng) == "equal"
    tossed = [judge(same, same, RaterCfg(beta=5.0), known, rng) for _ in range(400)]
    assert Counter(tossed)["a"] == pytest.approx(200, abs=40)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"beta": 2.0}, "--beta .* needs --rater stochastic"),
        ({"stochastic": True, "beta": 0.0}, "--beta must be positive, got 0"),
        ({"gamma": 0.0}, r"--gamma must lie in \(0, 1\], got 0"),
        ({"mistakes": 1.5}, r"--mistakes must lie in \[0, 1\], got 1.5"),
        ({"skip": -0.1}, r"--skip must lie in \[0, 1\], got -0.1"),
        ({"equal": math.nan}, "--equal must not be negative, got nan"),
    ],
)
def test_settings_no_rater_can_have_are_refused(options: dict, message: str) -> None:
    rater = "stochastic" if options.pop("stochastic", False) else "perfect"
    answer = Answer(
        dataset=Path("d"), criterion="task", rater=rater, erring=Erring(**options)
    )
    with pytest.raises(GaitprefError, match=message):
        rater_cfg(answer)


def test_a_clip_is_scored_as_part_of_its_episode() -> None:
    """A criterion that looks back sees what came before the clip in its episode."""
    rows = np.zeros((40, FEATURE_DIM), np.float32)
    rows[:, column("base_height")] = np.arange(40)[:, None]

    def elapsed(features: Tensor, starts: Tensor) -> Tensor:
        assert starts[:, 0].tolist() == [True] + [False] * 39
        return torch.ones(starts.shape).cumsum(dim=0)

    def height(features: Tensor) -> Tensor:
        return features[..., column("base_height")][..., 0]

    clip = Clip("episode", 10, 5)
    looking_back = ClipScores(lambda _: rows, SequenceCriterion(elapsed, 40))
    assert looking_back(clip).tolist() == [11, 12, 13, 14, 15]
    assert ClipScores(lambda _: rows, height)(clip).tolist() == [10, 11, 12, 13, 14]


def test_a_run_remembers_how_its_rater_errs(tmp_path: Path) -> None:
    """Also one that never does: the settings come back out of the file as they were."""
    style = resolve(Loop(run=Path("r")))
    bald = replace(style.method, questions=Questions(strategy="bald"))
    for name, rater in (("perfect", RaterCfg()), ("human", RaterCfg(beta=1.0))):
        cfg = replace(style, simulated=rater, method=bald)
        claim(tmp_path / name, cfg, {})
        assert read_config(tmp_path / name) == cfg
