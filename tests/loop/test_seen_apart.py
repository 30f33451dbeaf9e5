"""How different the clips look that a loop asks people about."""

from __future__ import annotations

import json
import math
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.walks import walk
from data.datasets.dataset import Dataset
from gaitpref.cli.main import main
from gaitpref.cli.options.options import Loop
from gaitpref.cli.shared.loop_arguments import resolve
from gaitpref.loop.between_rounds import keep_asked
from gaitpref.loop.loop_cfg import LoopCfg, RunError
from gaitpref.loop.people import People
from gaitpref.loop.questions_stage import questions_stage
from gaitpref.loop.run_config import CONFIG_NAME, claim, read_config
from gaitpref.loop.run_dir import Round, context_of
from gaitpref.loop.run_inputs import inputs_of
from gaitpref.method.questions import Questions
from tests.helpers.small_loop import human_cfg

RUN = Path("run")


@pytest.fixture
def recorded(tmp_path: Path) -> tuple[Path, Dataset]:
    """A run whose first round recorded eleven robots alike and one that takes a few
    more steps: two thirds of what people just notice."""
    run = tmp_path / "run"
    dataset = Dataset.create(run / "dataset")
    entries = dataset.add_episodes(
        walk(60, seed=index, step_hz=2.0 if index else 2.3) for index in range(12)
    )
    (run / "rounds/00").mkdir(parents=True)
    names = [entry.sha256 for entry in entries]
    Round(run, 0).recorded.write_text(json.dumps(names))
    return run, dataset


def asking(cfg: LoopCfg, apart: float | None) -> LoopCfg:
    questions = replace(cfg.method.questions, apart=apart)
    return replace(cfg, method=replace(cfg.method, questions=questions))


def shown_most(dataset: Dataset) -> tuple[int, int]:
    """In how many pairs the robot is that comes most often, and how many there are."""
    with dataset.answers() as store:
        pairs = store.pairs()
    shown = Counter(clip.rollout for pair in pairs for clip in (pair.a, pair.b))
    return max(shown.values()), len(pairs)


@pytest.mark.parametrize(("apart", "all_show_it"), [(0.5, True), (None, False)])
def test_experts_are_asked_about_finer_differences(
    recorded: tuple[Path, Dataset], apart: float | None, *, all_show_it: bool
) -> None:
    """Meanwhile."""
    run, dataset = recorded
    keep_asked(run, asking(human_cfg(), apart), dataset, 1)
    most, count = shown_most(dataset)
    assert count == 4
    assert (most == count) == all_show_it


@pytest.mark.parametrize(("apart", "all_show_it"), [(0.5, True), (None, False)])
def test_a_round_asks_experts_so_too(
    recorded: tuple[Path, Dataset], apart: float | None, *, all_show_it: bool
) -> None:
    """From its first batch on, before anybody answers."""
    run, dataset = recorded
    cfg = asking(human_cfg(), apart)
    first = Round(run, 0)

    class Asked(Exception):
        pass

    def require_page() -> None:
        raise Asked

    people = People(require_page=require_page)
    criterion = inputs_of(cfg).criterion
    with pytest.raises(Asked):
        questions_stage(cfg, first, context_of(cfg, first), dataset, criterion, people)
    most, count = shown_most(dataset)
    assert count >= 8
    assert (most == count) == all_show_it


def test_a_run_keeps_how_different_its_clips_are(tmp_path: Path) -> None:
    """Whoever goes on with it asks so, and one that was told nothing is as before."""
    run = tmp_path / "run"
    told = resolve(Loop(run=RUN, rater="human", apart=0.5))
    claim(run, told, {})
    assert read_config(run).method.questions.apart == 0.5
    claim(run, told, {})
    for other in (None, 0.7):
        with pytest.raises(RunError, match=r"\(method\.questions\.apart 0\.5 -> "):
            claim(run, asking(told, other), {})

    untold = tmp_path / "untold"
    claim(untold, asking(told, None), {})
    assert "apart:" not in (untold / CONFIG_NAME).read_text()
    with pytest.raises(RunError, match=r"\(method\.questions\.apart None -> 0\.5"):
        claim(untold, told, {})


def test_only_people_are_asked_about_what_looks_different() -> None:
    with pytest.raises(RunError, match="leave it out with --rater simulated"):
        resolve(Loop(run=RUN, apart=0.5))
    for apart in (-1.0, math.nan):
        with pytest.raises(ValueError, match="apart must be at least 0, got"):
            Questions(apart=apart)


@pytest.mark.parametrize("apart", ["-1", "nan"])
def test_a_difference_that_cannot_be_is_refused_as_it_is_typed(
    apart: str, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["loop", "--run", "run", "--rater", "human", f"--apart={apart}"]
    assert main(asked) == 2
    assert "--apart" in capsys.readouterr().err
