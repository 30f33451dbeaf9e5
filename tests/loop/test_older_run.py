"""A run that an earlier version made, with its modules in other places."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import yaml

from gaitpref.cli.main import main
from gaitpref.loop.loop_cfg import RunError
from gaitpref.loop.run import run_loop
from gaitpref.loop.run_config import CONFIG_NAME, read_config
from gaitpref.method.budget import FrontLoaded
from rewardmodel.cfg import LinearCfg
from tests.helpers.older_run import older_run


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return older_run(tmp_path / "run")


@pytest.fixture
def without_what_left(run: Path) -> Path:
    """As if it had been begun without decisions that there are no more."""
    path = run / CONFIG_NAME
    told = yaml.safe_load(path.read_text())
    told["method"]["once_it_walks"] = None
    for name in LinearCfg.REMOVED:
        del told["method"]["reward"]["linear"][name]
    for name in FrontLoaded.REMOVED:
        del told["method"]["budget"][name]
    path.write_text(yaml.safe_dump(told))
    return run


def test_one_with_a_decision_that_left_is_shown_and_not_gone_on_with(run: Path) -> None:
    with pytest.raises(RunError, match="once_it_walks"):
        run_loop(run, read_config(run))
    assert main(["report", "--run", str(run)]) == 0
    page = (run / "report/index.html").read_text()
    assert "than what it started from, which stays" in page


def test_a_finished_one_is_left_as_it_is(without_what_left: Path) -> None:
    run = without_what_left
    before = {
        path: path.read_bytes() for path in run.rglob("*") if path.suffix == ".pt"
    }
    run_loop(run, read_config(run))
    assert {path: path.read_bytes() for path in before} == before


def test_one_that_was_cut_off_goes_on(without_what_left: Path) -> None:
    run = without_what_left
    shutil.rmtree(run / "rounds" / "01")
    run_loop(run, read_config(run))
    assert (run / "rounds" / "01" / "report.json").exists()


def test_its_data_set_is_whole(run: Path) -> None:
    assert main(["data", "verify", "--dataset", str(run / "dataset")]) == 0
