"""Sweeps: real loops, whoever runs them; killed and gone on with; failures are told."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest

from gaitpref.cli.main import main, parse
from gaitpref.cli.options.options import Sweep
from gaitpref.cli.shared.sweep_arguments import sweep_cells
from tests.helpers.one_ray import one_ray
from tests.helpers.small_sweep import made_by, small_plan
from tests.helpers.waiting import wait_for

FOREIGN = "cells/high_step-seed2/notes.txt"
LONGEST_S = 300
"""What takes longer hangs."""
NAMES = ["high_step-seed0", "high_step-seed1"]


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two loops of one round."""
    return small_plan(tmp_path_factory.mktemp("plan"))


@pytest.fixture(scope="module")
def swept(plan: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three loops in two processes, the last of which finds what is not its own."""
    out = tmp_path_factory.mktemp("sweep") / "out"
    command = ["sweep", "--out", str(out), "--plan", str(plan), "--jobs", "2"]
    assert main([*command, "--seed", "0", "1"]) == 0
    (out / FOREIGN).parent.mkdir()
    (out / FOREIGN).write_text("mine")
    assert main([*command, "--seed", "0", "1", "2"]) == 1
    return out


def made(out: Path, names: Sequence[str] = NAMES) -> dict[str, dict[str, str]]:
    """What the loops of a sweep made, by their names."""
    return {name: made_by(out / "cells" / name) for name in names}


def test_a_failure_stops_nothing_and_is_named(swept: Path) -> None:
    """With why, and its log; means are of those that finished."""
    found = json.loads((swept / "results.json").read_text())
    assert list(found["failures"]) == ["high_step-seed2"]
    assert "is not empty" in found["failures"]["high_step-seed2"]
    assert "is not empty" in (swept / "logs/high_step-seed2.log").read_text()
    assert (swept / FOREIGN).read_text() == "mine"
    (mean,) = found["means"]
    assert mean["seeds"] == [0, 1]
    assert mean["answers"] == [12, 12]
    page = (swept / "index.html").read_text()
    assert 'href="logs/high_step-seed2.log"' in page
    for name in NAMES:
        link = f"cells/{name}/report/index.html"
        assert f'href="{link}"' in page
        assert (swept / link).exists()


def test_the_table_is_what_the_runs_reported(swept: Path) -> None:
    """A line for each, and their mean with the t-interval of two: 12.706 errors."""
    with (swept / "results.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["cell"] for row in rows] == NAMES
    returns = []
    for row in rows:
        report = swept / "cells" / row["cell"] / "rounds/01/report.json"
        last = json.loads(report.read_text())
        assert float(row["final_return"]) == last["evaluation"]["return_mean"]
        assert row["verdict"] == last["verdict"]["word"]
        returns.append(last["evaluation"]["return_mean"])
    found = json.loads((swept / "results.json").read_text())["means"][0]
    assert found["final_return"]["mean"] == pytest.approx(sum(returns) / 2)
    width = 12.7062 * abs(returns[0] - returns[1]) / 2
    assert found["final_return"]["half_width"] == pytest.approx(width, rel=1e-4)


def test_what_is_finished_is_not_run_again_and_not_with_other_settings(
    swept: Path, plan: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["sweep", "--out", str(swept), "--plan", str(plan)]
    before = made(swept)
    assert main(command) == 0
    said = capsys.readouterr().err
    assert "2 loops, 2 of them finished already; 0 to run" in said
    assert f"next: `gaitpref report --run {swept}/cells/high_step-seed" in said
    assert main([*command, "--labels", "13"]) == 1
    said = capsys.readouterr().err
    assert "was started with other settings (labels 12 -> 13)" in said
    assert "; 0 to run" in said
    assert "next: the same command goes on with what is not finished" in said
    assert made(swept) == before


def test_it_is_the_same_whoever_runs_it(
    swept: Path, plan: Path, tmp_path: Path
) -> None:
    """Processes and Ray."""
    (first,) = made(swept, NAMES[:1]).values()
    assert len(first) > 40
    words = ["sweep", "--out", str(tmp_path / "out"), "--plan", str(plan)]
    words += ["--seed", "0", "--ray", "local"]
    with one_ray():
        assert main(words) == 0
    command = parse(words)
    assert isinstance(command, Sweep)
    (cell,) = sweep_cells(command)
    assert made_by(tmp_path / "out" / "cells" / cell.name) == first


def test_killed_and_interrupted_it_ends_the_same(
    swept: Path, plan: Path, tmp_path: Path
) -> None:
    """A loop's process is killed and tried again; a Ctrl-C leaves what is finished and
    no process; the same command goes on."""
    out = tmp_path / "out"
    words = ["sweep", "--jobs", "2", "--out", str(out), "--plan", str(plan)]
    with sweeping(words) as process:
        first, second = (out / "cells" / name for name in NAMES)
        wait_for(lambda: any(second.glob("dataset/rollouts/*/*.mcap")))
        victim = max(children(process.pid))
        os.kill(victim, signal.SIGKILL)
        wait_for(
            lambda: victim not in (left := children(process.pid)) and len(left) == 2
        )
        # The one tried again waits, so that it is not finished at the Ctrl-C.
        behind = max(children(process.pid))
        os.kill(behind, signal.SIGSTOP)
        ended = [run / "report/index.html" for run in (first, second)]
        wait_for(ended[0].exists)
        working = children(process.pid)
        process.send_signal(signal.SIGINT)
        os.kill(behind, signal.SIGCONT)
        assert process.wait(LONGEST_S) == 130
    assert not any(Path(f"/proc/{pid}").exists() for pid in working)
    assert [page.exists() for page in ended].count(True) == 1
    assert main(words) == 0
    assert made(out) == made(swept)


@contextmanager
def sweeping(words: Sequence[str]) -> Iterator[subprocess.Popen[bytes]]:
    """The command in a process of its own, which is gone afterwards."""
    command = [sys.executable, "-m", "gaitpref", *words]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        try:
            yield process
        finally:
            process.kill()


def children(parent: int) -> list[int]:
    """Processes of loops that a sweep has started: copies of a child of its own."""
    return [
        loop
        for child in _started_by(parent)
        if b"forkserver" in _command(child)
        for loop in _started_by(child)
    ]


def _started_by(parent: int) -> list[int]:
    # One may end while it is looked at.
    try:
        text = Path(f"/proc/{parent}/task/{parent}/children").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return []
    return [int(pid) for pid in text.split()]


def _command(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except (FileNotFoundError, ProcessLookupError):
        return b""
