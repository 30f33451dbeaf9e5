"""Whether answers err is decided once in a run, by the first reward there is."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from data.datasets.dataset import Dataset
from gaitpref.loop.fit_stage import fit_stage
from gaitpref.loop.loop_cfg import LoopCfg
from gaitpref.loop.people import People
from gaitpref.loop.questions_stage import questions_stage
from gaitpref.loop.run import run_loop
from gaitpref.loop.run_dir import Round, context_of, decided_before
from gaitpref.loop.run_inputs import inputs_of
from gaitpref.method.context import RoundContext
from gaitpref.method.method import FROM_SCRATCH, STYLE
from gaitpref.method.noisy import NoisyAnswers
from gaitpref.raters.rater_cfg import RaterCfg
from rewardmodel import FitCfg
from rewardmodel.linear.noise_level import takes_to_err
from rewardmodel.models.storage import load_reward
from tests.helpers.small_loop import Killed, small_cfg, stopped
from tests.rewardmodel.test_acquisition import model_of


def told_to_rounds(
    run: Path, cfg: LoopCfg, monkeypatch: pytest.MonkeyPatch
) -> list[RoundContext]:
    """Run a loop, or go on with it; the contexts of its rounds."""
    found: list[RoundContext] = []

    def kept(cfg: LoopCfg, round: Round) -> RoundContext:
        found.append(context_of(cfg, round))
        return found[-1]

    with monkeypatch.context() as patch:
        patch.setattr("gaitpref.loop.run.context_of", kept)
        run_loop(run, cfg)
    return found


def erring_cfg() -> LoopCfg:
    """Answers enough to see that a fifth of them is wrong."""
    return replace(small_cfg(seed=1), labels=70, simulated=RaterCfg(mistakes=0.2))


@pytest.mark.parametrize(
    ("share", "noisy"), [(0.0, False), (0.1, False), (0.1001, True), (0.7, True)]
)
def test_answers_err_of_which_more_than_a_tenth_is_random(
    share: float, noisy: bool
) -> None:
    model = model_of({"height": 1.0})
    model.provenance = replace(
        model.provenance, cfg=replace(FitCfg(), error_share=share)
    )
    found = NoisyAnswers.of(model)
    assert found.noisy == noisy
    assert (found.error_share, found.answers) == (
        share,
        model.provenance.report.answers,
    )
    assert str(found).startswith("the answers err: " if noisy else "the answers hardly")
    assert f"{share:.0%} of the first {found.answers} look random" in str(found)


@pytest.mark.parametrize("noisy", [None, True, False])
def test_every_later_fit_is_told(noisy: bool | None) -> None:
    """Also one that expects a walk."""
    for method in (FROM_SCRATCH, STYLE):
        for number in range(4):
            context = RoundContext(number=number, rounds=4, labels=60, noisy=noisy)
            assert method.fit_of(context).answers_err is noisy


def test_it_is_decided_once_told_and_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By the first reward, for every later round, whoever is killed in between; a later
    reward that finds otherwise changes nothing."""
    run, cfg = tmp_path / "run", erring_cfg()
    stopped("report_stage", 0, run, cfg)
    decided = Round(run, 0).decided
    found = json.loads(decided.read_text())
    first = load_reward(Round(run, 0).reward).provenance
    assert found["noisy"]
    assert found["error_share"] == first.cfg.error_share > 0.1
    assert found["answers"] == first.report.answers
    told = " ".join(capsys.readouterr().err.split())
    assert told.count(found["told"]) == 1
    assert found["told"].startswith("the answers err: ")
    written, changed_ns = decided.read_bytes(), decided.stat().st_mtime_ns

    contexts = told_to_rounds(run, cfg, monkeypatch)
    assert [context.noisy for context in contexts] == [None, True, True]
    second = load_reward(Round(run, 1).reward).provenance.cfg
    assert second.answers_err is True
    assert takes_to_err(second)
    assert (decided.read_bytes(), decided.stat().st_mtime_ns) == (written, changed_ns)
    assert list(run.glob("rounds/*/decided.json")) == [decided]
    assert "the answers err" not in " ".join(capsys.readouterr().err.split())
    reports = [
        json.loads((run / f"rounds/0{n}/report.json").read_text()) for n in range(3)
    ]
    assert [report.get("decided") for report in reports] == [found, None, None]

    # What is written is what holds, not what a reward says.
    decided.write_text(json.dumps({**found, "noisy": False}))
    contexts = told_to_rounds(run, cfg, monkeypatch)
    assert [context.noisy for context in contexts] == [None, False, False]
    assert json.loads(decided.read_text())["noisy"] is False


def test_killed_before_its_reward_is_kept_it_decides_the_same(tmp_path: Path) -> None:
    run, cfg = tmp_path / "run", small_cfg()
    with pytest.MonkeyPatch.context() as patch:

        def killed(*others: object) -> None:
            raise Killed

        patch.setattr("gaitpref.loop.fit_stage.save_reward", killed)
        with pytest.raises(Killed):
            run_loop(run, cfg)
    decided = Round(run, 0).decided
    assert not Round(run, 0).reward.exists()
    before = decided.read_bytes()
    stopped("report_stage", 0, run, cfg)
    assert Round(run, 0).reward.exists()
    assert decided.read_bytes() == before


def test_where_answers_prefer_too_little_the_next_reward_decides(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A reward of 0 was fitted to nothing, and says nothing of who answered."""
    run, cfg = tmp_path / "run", replace(small_cfg(), labels=64)
    equal = replace(cfg, simulated=RaterCfg(equal=1e9))
    stopped("questions_stage", 1, run, equal)
    first, second, third = (Round(run, number) for number in range(3))
    dataset = Dataset.open(run / "dataset")
    assert first.reward.exists()
    assert not first.decided.exists()
    assert decided_before(second) == {}
    assert "decided" not in json.loads(first.report.read_text())
    context = context_of(cfg, second)
    assert context.noisy is None
    assert "look random" not in capsys.readouterr().err

    # From here on the rater prefers.
    criterion = inputs_of(cfg).criterion
    questions_stage(cfg, second, context, dataset, criterion, People())
    fit_stage(cfg, second, context, dataset, People())
    found = json.loads(second.decided.read_text())
    assert not first.decided.exists()
    assert found["told"] in " ".join(capsys.readouterr().err.split())
    assert found["answers"] == load_reward(second.reward).provenance.report.answers
    assert decided_before(second) == {}
    assert decided_before(third) == found
    assert context_of(cfg, third).noisy == found["noisy"]
