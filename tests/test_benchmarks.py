"""The benchmarks run in their small version, end to end."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from benchmarks import hour


def test_learning(tmp_path: Path) -> None:
    """Every figure of the goals is there, as a number, in one flat object."""
    figures = tmp_path / "figures.json"
    command = [sys.executable, "-m", "benchmarks.learning", "--quick"]
    subprocess.run(
        [*command, "--json", str(figures), "--work", str(tmp_path / "work")], check=True
    )
    result = json.loads(figures.read_text())
    for name in (
        "train_tracking_error_m_s",
        "train_falls",
        "fit_300_pairs_s",
        "scratch_fraction_median",
        "scratch_reached",
        "scratch_wall_s_max",
        "scratch_peak_mb",
    ):
        assert isinstance(result[name], int | float), name


def test_nothing_is_lost_or_doubled_in_an_hour_in_short() -> None:
    """Eight raters answer at once; the benchmark does the same for longer."""
    figures = hour.measured(6)
    assert figures.hour_answers == 8 * 6
    assert figures.hour_lost == figures.hour_doubled == 0
    # Eight pages at work: no leak shows in so little, but a burst would.
    assert figures.hour_memory_growth_mb < 60
