"""A run that an earlier version made, with its modules in other places."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from gaitpref.cli.main import main
from gaitpref.loop.run import run_loop
from gaitpref.loop.run_config import read_config
from tests.helpers.older_run import older_run


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return older_run(tmp_path / "run")


def test_a_finished_one_is_left_as_it_is_and_shown(run: Path) -> None:
    before = {
        path: path.read_bytes() for path in run.rglob("*") if path.suffix == ".pt"
    }
    page = run_loop(run, read_config(run))
    assert {path: path.read_bytes() for path in before} == before
    page.unlink()
    assert main(["report", "--run", str(run)]) == 0
    assert "not better than what it started from" in page.read_text()


def test_one_that_was_cut_off_goes_on(run: Path) -> None:
    shutil.rmtree(run / "rounds" / "01")
    run_loop(run, read_config(run))
    assert (run / "rounds" / "01" / "report.json").exists()


def test_its_data_set_is_whole(run: Path) -> None:
    assert main(["data", "verify", "--dataset", str(run / "dataset")]) == 0
