"""`gaitpref sweep`: many loops, run or gone on with, and compared."""

from __future__ import annotations

import json
from collections.abc import Sequence

from rich import box
from rich.table import Table

from gaitpref.cli.options import options
from gaitpref.cli.shared.simulator import require_sim
from gaitpref.cli.shared.sweep_arguments import gpu_share, sweep_cells
from gaitpref.console.extras import require
from gaitpref.console.progress import console, counted
from gaitpref.console.terminal import PlainConsole, say
from gaitpref.executor.choose_executor import choose_executor, cores_each
from gaitpref.sweep.run_sweep import SweepResult, contents_of, how_far, run_sweep
from gaitpref.sweep.sweep_cell import SweepCell, SweepDir
from gaitpref.sweep.sweep_report import write_sweep
from gaitpref.sweep.sweep_table import as_json, cells_of, heads, means


def run(command: options.Sweep) -> int:
    """Run the command; gives the exit code."""
    if command.ray is not None:
        require("ray", "scale")
    executor = choose_executor(jobs=command.jobs, ray=command.ray)
    with counted("looking at every loop") as tell:
        cells = sweep_cells(command, tell)
    gpus = gpu_share(command, cells)
    if command.ray is None:
        for sim in {cell.cfg.steps.sim for cell in cells}:
            require_sim(sim)
    places = SweepDir(command.out)
    if command.dry_run:
        contents_of(cells)
        _show_plan(cells, places, as_object=command.json)
        if not command.json:
            console.next("the same command without --dry-run runs what is not finished")
        return 0
    cores = cores_each(len(cells), jobs=command.jobs, ray=command.ray)
    result = run_sweep(command.out, cells, executor, gpus=gpus, cores=cores)
    page = write_sweep(command.out, result)
    if command.json:
        say(as_json(result))
    else:
        _show(result)
    for name, why in result.failures.items():
        console.print(f"not finished: {name}: {why}; see {places.log(name)}")
    console.print(f"the report is {page}")
    if not command.json:
        console.next(_next(result, places))
    return 1 if result.failures else 0


def _next(result: SweepResult, places: SweepDir) -> str:
    if result.failures:
        return "the same command goes on with what is not finished"
    most = max(result.rows, key=lambda row: row.gained)
    return (
        f"`gaitpref report --run {places.run(most.name)} --open` shows the loop that "
        "gained most; more seeds in the same command make the intervals narrower"
    )


def _show_plan(
    cells: Sequence[SweepCell], places: SweepDir, *, as_object: bool
) -> None:
    states = {cell.name: how_far(places.run(cell.name), cell.cfg) for cell in cells}
    if as_object:
        say(json.dumps({"cells": states}, indent=1))
        return
    table = Table("loop", "so far", box=box.SIMPLE_HEAD)
    for name, state in states.items():
        table.add_row(name, state)
    out = PlainConsole()
    out.print(table)
    finished = sum(state == "finished" for state in states.values())
    out.print(f"{len(cells)} loops, {finished} of them finished")


def _show(result: SweepResult) -> None:
    groups = means(result.rows)
    if not groups:
        return
    table = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False)
    for place, name in enumerate(heads(groups)):
        # Where it is too narrow, figures break before their interval.
        table.add_column(name, no_wrap=place < len(groups[0].settings))
    for group in groups:
        table.add_row(*cells_of(group))
    PlainConsole().print(table)
