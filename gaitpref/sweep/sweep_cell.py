"""One cell of a sweep: a loop in a directory of its own, and what came of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from data.datasets.dataset import Dataset
from data.files.files import read_json
from gaitpref.loop.loop_cfg import LoopCfg
from gaitpref.loop.run import run_loop
from gaitpref.loop.run_dir import Round
from gaitpref.loop.run_report import PAGE_NAME

from .sweep_plan import SEED


@dataclass(frozen=True, kw_only=True)
class SweepCell:
    """A loop that is to be run."""

    name: str
    """Of its directory and its log."""
    settings: Mapping[str, Any]
    """What the sweep varies, as it is here."""
    cfg: LoopCfg
    """Everything that decides how it goes."""

    @property
    def on_gpu(self) -> bool:
        """Whether it trains on one."""
        sim = self.cfg.steps.sim
        return sim is not None and sim.device == "cuda"


@dataclass(frozen=True)
class SweepDir:
    """The files of a sweep."""

    root: Path

    @property
    def asked(self) -> Path:
        """Cells and their settings, as the sweep was last asked for."""
        return self.root / "sweep.json"

    @property
    def page(self) -> Path:
        return self.root / "index.html"

    @property
    def rows(self) -> Path:
        """A row for each finished cell."""
        return self.root / "results.csv"

    @property
    def results(self) -> Path:
        """Rows, means over seeds, failures."""
        return self.root / "results.json"

    def run(self, name: str) -> Path:
        """The run of a cell."""
        return self.root / "cells" / name

    def log(self, name: str) -> Path:
        """What was said while it ran."""
        return self.root / "logs" / f"{name}.log"


def run_cell(run: Path, cfg: LoopCfg) -> None:
    """Run a loop or go on with it, in a process that does nothing else."""
    torch.set_num_threads(1)
    run_loop(run, cfg)


def is_finished(run: Path, cfg: LoopCfg) -> bool:
    """Whether a loop has come to its end."""
    return Round(run, cfg.rounds).report.exists() and (run / PAGE_NAME).exists()


@dataclass(frozen=True, kw_only=True)
class SweepRow:
    """What came of a finished cell."""

    name: str
    settings: Mapping[str, Any]
    start_return: float
    """Return, under the criterion, of the policy the run started from."""
    final_return: float
    """The same of its last policy."""
    tracking_error_m_s: float
    falls_per_minute: float
    verdict: str
    """The run's own word on whether it ended better; empty where it kept no answers
    for that."""
    answers: int
    """All that were given."""

    @property
    def gained(self) -> float:
        """What the return rose by."""
        return self.final_return - self.start_return

    @property
    def group(self) -> tuple[Any, ...]:
        """All that is varied but the seed."""
        return tuple(repr(v) for name, v in self.settings.items() if name != SEED)


def read_row(cell: SweepCell, run: Path) -> SweepRow:
    """What a finished cell reported.

    Raises:
        FileError: a report is damaged.
    """
    first = read_json(Round(run, 0).report)
    last = read_json(Round(run, cell.cfg.rounds).report)
    with Dataset.open(run / "dataset").answers() as store:
        answers = store.count()
    return SweepRow(
        name=cell.name,
        settings=cell.settings,
        start_return=first["evaluation"]["return_mean"],
        final_return=last["evaluation"]["return_mean"],
        tracking_error_m_s=last["evaluation"]["tracking_error_m_s"],
        falls_per_minute=last["evaluation"]["falls_per_minute"],
        verdict=last.get("verdict", {}).get("word", ""),
        answers=answers,
    )
