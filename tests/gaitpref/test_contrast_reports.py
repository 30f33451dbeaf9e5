"""Whether what stands on the pages that need no server can be read, both themes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import pytest

from benchmarks.walks import walking_dataset
from gaitpref.arena.arena import Standing
from gaitpref.arena.arena_page import write_arena_page
from gaitpref.arena.games import Answered, Player
from gaitpref.arena.strengths import Match, Ranking
from gaitpref.cli.main import main
from gaitpref.loop.run_report import write_report
from gaitpref.sweep.run_sweep import SweepResult
from gaitpref.sweep.sweep_cell import SweepRow
from gaitpref.sweep.sweep_report import write_sweep
from tests.helpers.contrast import contrasts, too_pale
from tests.helpers.curves_of_reports import drawn
from tests.helpers.label_browser import launched
from tests.helpers.older_run import older_run

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One for all tests."""
    with launched() as found:
        yield found


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run."""
    return older_run(tmp_path_factory.mktemp("older") / "run")


@pytest.fixture(scope="module")
def report(run: Path) -> Path:
    """Its page."""
    with drawn():
        return write_report(run)


@pytest.fixture(scope="module")
def explained(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of what its reward likes."""
    out = tmp_path_factory.mktemp("explained")
    reward = run / "rounds" / "00" / "reward"
    line = ["explain", "--reward", str(reward), "--dataset", str(run / "dataset")]
    assert main([*line, "--out", str(out), "--count", "1"]) == 0
    return out / "index.html"


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of loops under two criteria, one of which failed."""
    rows = tuple(
        SweepRow(
            name=f"{criterion}-seed{seed}",
            settings={"criterion": criterion, "steps.round": 1000, "seed": seed},
            start_return=1.0,
            final_return=2.0 + seed,
            tracking_error_m_s=0.1,
            falls_per_minute=0.0,
            verdict="better",
            answers=40,
        )
        for criterion in ("high_step", "crouch")
        for seed in range(3)
    )
    result = SweepResult(rows=rows, failures={"crouch-seed3": "no space is left"})
    return write_sweep(tmp_path_factory.mktemp("sweep"), result)


@pytest.fixture(scope="module")
def arena(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of two policies that somebody told apart."""
    folder = tmp_path_factory.mktemp("arena")
    walking_dataset(folder / "dataset", pairs=0, episodes=2)
    players = tuple(
        Player(name=name, file=folder / name, sha256="0" * 64) for name in "ab"
    )
    answer = Answered(
        match=Match(first=0, second=1, score=1.0, question="q"),
        rater="ann",
        command=(0.5, 0.0, 0.0),
        note="b limps",
    )
    half = np.array([1.0, -1.0])
    ranking = Ranking(
        strengths=half, low=half - 0.5, high=half + 0.5, order=(0, 1), kept=(0.9,)
    )
    standing = Standing(
        players=players, ranking=ranking, answers=(answer,), open_questions=0
    )
    return write_arena_page(folder, standing)


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("name", ["report", "arena", "explained", "sweep"])
def test_what_is_written_can_be_read(
    browser: Browser,
    request: pytest.FixtureRequest,
    name: str,
    theme: Literal["light", "dark"],
) -> None:
    """By the colours that it really has, figures included."""
    path: Path = request.getfixturevalue(name)
    context = browser.new_context(color_scheme=theme)
    page = context.new_page()
    page.goto(path.as_uri())
    page.evaluate("document.querySelectorAll('details').forEach((d) => d.open = true)")
    found = contrasts(page)
    context.close()
    assert len(found) > 30
    assert too_pale(found) == {}
