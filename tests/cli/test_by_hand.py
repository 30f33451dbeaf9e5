"""Stages done by hand make what the loop makes, bit for bit."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from data.datasets.dataset import Dataset
from data.files.files import read_json
from gaitpref.cli.main import main
from gaitpref.loop.loop_cfg import LoopCfg
from gaitpref.loop.run_dir import Round, seed_of
from policy.env.feature_row import OBS_DIM
from policy.training.checkpoint import load_policy
from tests.helpers.small_loop import small_cfg, stopped


def cfg_of(method: str) -> LoopCfg:
    cfg = small_cfg(base="task" if method == "style" else "none")
    # By hand the networks of a policy are those it has, and 32 robots are asked for.
    return replace(cfg, labels=24)


@pytest.fixture(scope="module", params=["style", "scratch"])
def method(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def looped(tmp_path_factory: pytest.TempPathFactory, method: str) -> tuple[Path, Path]:
    """A loop that was killed after its first fit, a copy of it as it was then, and the
    loop after its first retraining."""
    folder = tmp_path_factory.mktemp(method)
    run, fitted = folder / "run", folder / "fitted"
    for number, stage in ((0, "report_stage"), (1, "record_stage")):
        stopped(stage, number, run, cfg_of(method))
        if number == 0:
            shutil.copytree(run, fitted)
    return fitted, run


def test_a_round_is_recorded_as_the_loop_does(
    looped: tuple[Path, Path], method: str, tmp_path: Path
) -> None:
    first, cfg = Round(looped[0], 0), cfg_of(method)
    words = [
        "record",
        "--policy",
        str(first.policy),
        "--dataset",
        str(tmp_path / "set"),
    ]
    words += ["--method", method, "--seed", str(seed_of(cfg, 0, 2))]
    words += ["--episodes", str(cfg.record.episodes)]
    assert main([*words, "--episode-s", f"{cfg.record.episode_s:g}"]) == 0
    found = {path.stem for path in (tmp_path / "set/rollouts").rglob("*.mcap")}
    assert found == set(read_json(first.recorded))


def test_a_reward_is_fitted_as_the_loop_does(
    looped: tuple[Path, Path], method: str, tmp_path: Path
) -> None:
    fitted, cfg = looped[0], cfg_of(method)
    words = [
        "fit",
        "--dataset",
        str(fitted / "dataset"),
        "--out",
        str(tmp_path / "own"),
    ]
    words += ["--method", method, "--rounds", str(cfg.rounds)]
    assert main([*words, "--seed", str(seed_of(cfg, 0, 5))]) == 0
    own, loops = (
        (folder / "reward.safetensors").read_bytes()
        for folder in (tmp_path / "own", Round(fitted, 0).reward)
    )
    assert own == loops


def test_questions_are_chosen_as_the_loop_does(
    looped: tuple[Path, Path],
    method: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """By the same rule, and who asks for more at a time than it would is told."""
    data = shutil.copytree(looped[0] / "dataset", tmp_path / "set")
    words = ["pairs", "--dataset", str(data), "--method", method]
    words += ["--reward", str(Round(looped[0], 0).reward)]
    batch = cfg_of(method).method.questions.batch
    for count in (batch, batch + 1):
        assert main([*words, "--count", str(count)]) == 0
        said = " ".join(capsys.readouterr().err.split())
        assert (f"a loop asks {batch} at a time" in said) == (count > batch)
    with Dataset.open(data).answers() as store:
        asked = {
            pair.strategy for number in (1, 2) for pair in store.pairs(round=number)
        }
    chosen = {"scratch": {"disagreement", "uniform"}, "style": {"information"}}
    assert asked == chosen[method]
    assert main([*words, "--count", "1", "--strategy", "bald"]) == 2
    assert f"--strategy beside --method {method}" in capsys.readouterr().err


def test_a_policy_is_retrained_as_the_loop_does(
    looped: tuple[Path, Path], method: str, tmp_path: Path
) -> None:
    (fitted, run), cfg = looped, cfg_of(method)
    first, second = Round(run, 0), Round(run, 1)
    words = ["train", "--out", str(tmp_path / "own"), "--reward", str(first.reward)]
    words += ["--init", str(first.policy), "--dataset", str(fitted / "dataset")]
    words += ["--method", method, "--round", "1", "--rounds", str(cfg.rounds)]
    words += ["--steps", str(cfg.steps.round)]
    words += ["--envs", "32", "--seed", str(seed_of(cfg, 1, 1))]
    assert main(words) == 0
    own, loops = (
        load_policy(path) for path in (tmp_path / "own/policy.pt", second.policy)
    )
    assert own.info.steps == loops.info.steps
    obs = torch.randn(7, OBS_DIM)
    assert torch.equal(own(obs), loops(obs))
    assert torch.equal(own.std, loops.std)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--round", "9"], "--round 9 is beyond the last"),
        (["--round", "2"], "--round 2 needs --first-reward REWARD"),
        (["--mirror", "--keep-task"], "--keep-task, --mirror beside --method style"),
        ([], "--method style needs --init POLICY"),
        (["--init", "{policy}"], "--method style needs --dataset DIR"),
        (
            ["--init", "{policy}", "--dataset", "{set}", "--round", "0"],
            "--round 0 trains on no learned reward",
        ),
        (
            ["--init", "{policy}", "--dataset", "{set}", "--reward", "crouch"],
            "--reward must be a directory of `gaitpref fit`, got crouch",
        ),
    ],
)
def test_what_a_method_needs_is_told(
    looped: tuple[Path, Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    told: str,
) -> None:
    first = Round(looped[0], 0)
    places = {"policy": str(first.policy), "set": str(looped[0] / "dataset")}
    asked = [word.format(**places) for word in words]
    if "--reward" not in asked:
        asked += ["--reward", str(first.reward)]
    out = ["--out", str(tmp_path / "own"), "--steps", "96", "--envs", "4"]
    assert main(["train", *out, "--method", "style", *asked]) == 2
    assert told in " ".join(capsys.readouterr().err.split())


def test_a_later_fit_is_told_what_the_first_decided(
    looped: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing decides it by itself, and nothing is fitted without it."""
    words = ["fit", "--dataset", str(looped[0] / "dataset"), "--method", "scratch"]
    assert main([*words, "--round", "1", "--out", str(tmp_path / "own")]) == 2
    assert "--round 1 needs --first-reward" in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "own").exists()
