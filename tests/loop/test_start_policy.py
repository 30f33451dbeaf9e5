"""A style's training goes on from the policy that the newest reward likes best."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
from torch import Tensor

from data.features import column
from gaitpref.loop.loop_cfg import LoopCfg
from gaitpref.loop.run_dir import Round, began_from
from gaitpref.loop.start_policy import choose_start
from gaitpref.method.method import FROM_SCRATCH, STYLE, Method
from gaitpref.method.start import BestLiked
from policy.training.checkpoint import holding_home
from policy.training.ppo import PpoCfg
from policy.training.setup import setting_of
from policy.training.train import TrainCfg, train
from tests.helpers.small_loop import small_cfg
from tests.loop.test_verdict_stage import wild


def quiet(features: Tensor, starts: Tensor) -> Tensor:
    """Joints that do not move."""
    return -features[..., column("joint_vel")].square().mean(dim=-1)


def lively(features: Tensor, starts: Tensor) -> Tensor:
    return -quiet(features, starts)


@pytest.fixture
def style() -> LoopCfg:
    return replace(small_cfg(base="task"), rounds=3)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("trained")
    ppo = PpoCfg(num_envs=32, hidden_sizes=(16,))
    setting = setting_of(None, None)
    train(out, setting.robot, TrainCfg(steps=768, env=setting.env, ppo=ppo, seed=0))
    return out / "policy.pt"


@pytest.fixture
def third(tmp_path: Path, trained: Path) -> Round:
    """A round before which two policies throw their legs about and the one between
    them stands still."""
    for number, policy in enumerate((wild, holding_home, wild)):
        file = Round(tmp_path, number).policy
        file.parent.mkdir(parents=True)
        file.write_bytes(policy(trained))
    round = Round(tmp_path, 3)
    round.root.mkdir()
    return round


def test_an_earlier_policy_that_is_liked_better_is_gone_on_from(
    style: LoopCfg, third: Round, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is written down, so that a run that was killed begins there again."""
    choose_start(style, third, quiet)
    assert began_from(third) == Round(third.run, 1).policy
    assert "goes on from the policy of round 1" in capsys.readouterr().err
    worth = json.loads(third.began.read_text())["learned_returns"]
    assert worth["1"] > max(worth["0"], worth["2"])
    choose_start(style, third, lively)
    assert began_from(third) == Round(third.run, 1).policy


def test_of_equal_ones_it_is_the_newest(style: LoopCfg, third: Round) -> None:
    """The first policy is the third's equal to the last byte."""
    choose_start(style, third, lively)
    assert began_from(third) == Round(third.run, 2).policy


def test_one_that_answers_spoke_against_is_left_alone(
    style: LoopCfg, third: Round
) -> None:
    Round(third.run, 1).approval.write_text(json.dumps({"approved": False}))
    choose_start(style, third, quiet)
    assert began_from(third) == Round(third.run, 2).policy


@pytest.mark.parametrize("method", [replace(STYLE, start=None), FROM_SCRATCH])
def test_where_it_is_not_wanted_or_from_scratch_it_is_the_last(
    style: LoopCfg, third: Round, method: Method
) -> None:
    choose_start(replace(style, method=method), third, quiet)
    assert not third.began.exists()
    assert began_from(third) == Round(third.run, 2).policy


@pytest.mark.parametrize(
    ("worth", "best"),
    [
        ({0: 1.0}, 0),
        ({0: 1.0, 1: 2.0, 2: 1.5}, 1),
        ({0: 2.0, 1: 2.0, 3: 2.0}, 3),
        ({3: 2.0, 0: 2.0}, 3),
        ({0: -math.inf, 2: -math.inf}, 2),
        ({0: -5.0, 2: -math.inf}, 0),
    ],
)
def test_the_most_is_best_and_of_equals_the_newest(
    worth: dict[int, float], best: int
) -> None:
    """In whatever order they are given, and where rounds between are left out."""
    assert BestLiked().choose(worth) == best


def test_one_whose_simulations_diverge_is_worth_nothing(
    style: LoopCfg, third: Round
) -> None:
    """Where all do, the last one is gone on from."""

    def none_is_left(features: Tensor, starts: Tensor) -> Tensor:
        raise ValueError("all simulations diverged")

    choose_start(style, third, none_is_left)
    assert began_from(third) == Round(third.run, 2).policy
