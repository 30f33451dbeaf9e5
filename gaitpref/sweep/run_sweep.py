"""Runs the cells of a sweep: skips what is finished, goes on with what was begun."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from data.errors import GaitprefError
from data.files.files import write_atomically
from data.files.lock import LOCK_NAME, only_writer
from gaitpref.console.progress import console, counting_bar
from gaitpref.executor.pieces import Executor, Piece
from gaitpref.loop.loop_cfg import LoopCfg
from gaitpref.loop.run_config import CONFIG_NAME, claim
from gaitpref.loop.run_inputs import inputs_of

from .sweep_cell import SweepCell, SweepDir, SweepRow, is_finished, read_row, run_cell
from .sweep_plan import SweepError


@dataclass(frozen=True, kw_only=True)
class SweepResult:
    """What a sweep came to."""

    rows: tuple[SweepRow, ...]
    """Of the finished cells, in the order of the plan."""
    failures: dict[str, str]
    """Why the others are not finished, by their names."""


def run_sweep(
    root: Path,
    cells: Sequence[SweepCell],
    executor: Executor,
    *,
    gpus: float = 1.0,
    cores: int = 1,
) -> SweepResult:
    """Run every cell to its end, as far as it goes.

    Args:
        root: Directory of the sweep; one that an earlier sweep left is gone on with.
        cells: What is run, in this order.
        executor: Who runs it.
        gpus: Share of a GPU for each cell that trains on one.
        cores: Cores for each cell.

    Raises:
        SweepError: the directory is something else, or a cell cannot be run at all.
        GaitprefError: another sweep is at it, or what a cell names cannot be used.
    """
    places = SweepDir(root.absolute())
    contents = contents_of(cells)
    pieces = {cell.name: _piece(cell, places, gpus, cores) for cell in cells}
    with only_writer(places.root, console.print):
        _begin(places, cells)
        failures = _of_others(places, cells, contents)
        left = [
            cell
            for cell in cells
            if cell.name not in failures
            and not is_finished(places.run(cell.name), cell.cfg)
        ]
        _tell(len(cells), len(left), len(failures))
        failures |= _run(places, left, [pieces[cell.name] for cell in left], executor)
        done = [cell for cell in cells if cell.name not in failures]
        rows = tuple(read_row(cell, places.run(cell.name)) for cell in done)
    return SweepResult(rows=rows, failures=failures)


def contents_of(cells: Sequence[SweepCell]) -> dict[str, Any]:
    """What stands behind the names in each cell's configuration, by the cell's name;
    so that all of it can be used is known before anything starts.

    Raises:
        GaitprefError: something cannot be used.
    """
    known: dict[Any, Any] = {}
    found = {}
    for cell in cells:
        cfg = cell.cfg
        names = (cfg.base, cfg.robot, cfg.criterion, cfg.env)
        if names not in known:
            known[names] = inputs_of(cfg).contents
        found[cell.name] = known[names]
    return found


def _begin(places: SweepDir, cells: Sequence[SweepCell]) -> None:
    there = [path.name for path in places.root.iterdir() if path.name != LOCK_NAME]
    if there and not places.asked.exists():
        raise SweepError(
            f"{places.root} is not empty and holds no {places.asked.name}: give a new "
            "directory"
        )
    asked = {cell.name: dict(cell.settings) for cell in cells}
    write_atomically(places.asked, json.dumps(asked, indent=1).encode())


def _of_others(
    places: SweepDir, cells: Sequence[SweepCell], contents: dict[str, Any]
) -> dict[str, str]:
    """Why cells cannot go on whose directory was made with other settings."""
    failures = {}
    for cell in cells:
        run = places.run(cell.name)
        if (run / CONFIG_NAME).exists():
            try:
                claim(run, cell.cfg, contents[cell.name])
            except GaitprefError as error:
                failures[cell.name] = str(error)
    return failures


def how_far(run: Path, cfg: LoopCfg) -> str:
    """How much of a loop is done, for people."""
    if is_finished(run, cfg):
        return "finished"
    rounds = len(list(run.glob("rounds/*/report.json")))
    if rounds:
        return f"{rounds} of {cfg.rounds + 1} rounds reported"
    return "begun" if (run / CONFIG_NAME).exists() else "not begun"


def _tell(count: int, left: int, failed: int) -> None:
    done = count - left - failed
    skipped = f", {done} of them finished already" if done else ""
    console.print(f"{count} loops{skipped}; {left} to run")


def _piece(cell: SweepCell, places: SweepDir, gpus: float, cores: int) -> Piece:
    return Piece(
        name=cell.name,
        function=run_cell,
        args=(places.run(cell.name), cell.cfg),
        gpus=gpus if cell.on_gpu else 0.0,
        cores=cores,
        log=places.log(cell.name),
    )


def _run(
    places: SweepDir,
    cells: Sequence[SweepCell],
    pieces: Sequence[Piece],
    executor: Executor,
) -> dict[str, str]:
    """Run what is not finished; gives the failures."""
    of_name = {cell.name: cell for cell in cells}
    failures: dict[str, str] = {}
    with (
        closing(executor.outcomes(pieces)) as outcomes,
        counting_bar("loops", len(cells)) as bar,
    ):
        for number, outcome in enumerate(outcomes, start=1):
            cell = of_name[outcome.piece.name]
            why = None if outcome.failure is None else outcome.failure.reason
            if why is None and not is_finished(places.run(cell.name), cell.cfg):
                why = (
                    f"it ended, and its files are not in {places.run(cell.name)}: the "
                    "sweep's directory must be one that every machine reaches"
                )
            if why is not None:
                failures[cell.name] = why
            told = f"failed: {why}" if why else _figures(cell, places)
            console.print(f"{number} of {len(cells)}: {cell.name}: {told}")
            bar.advance(bar.task_ids[0])
    return failures


def _figures(cell: SweepCell, places: SweepDir) -> str:
    row = read_row(cell, places.run(cell.name))
    return (
        f"return {row.start_return:.2f} -> {row.final_return:.2f}, tracking error "
        f"{row.tracking_error_m_s:.2f} m/s"
    )
