"""Does it learn what the rater wants: tasks x answers x raters x methods x seeds.

`python -m benchmarks.preferences` takes hours on two cores and can be interrupted
anywhere: a finished row is a file in `--results`, and an unfinished one goes on.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
import threading
import time
import traceback
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from data.errors import GaitprefError

from .preference_plan import METHODS, RATERS, TASKS, Cell, plan
from .preference_row import Places, forget, run_cell
from .preference_table import publish_rows, read_rows

console = Console(stderr=True, highlight=False, soft_wrap=True)


@dataclass(frozen=True, kw_only=True)
class Options:
    """Run what is not finished, then write table, plots and JSON from all rows."""

    tasks: tuple[str, ...] = ()
    """Only these; by default all but the one that is held back."""
    methods: tuple[str, ...] = ()
    """Only these; by default the loop as it is."""
    raters: tuple[str, ...] = ()
    """Only these; by default all."""
    answers: tuple[int, ...] = ()
    """Only rows with so many answers; by default all."""
    robot: tuple[str, Path] | None = None
    """Another robot than the one that ships: a name for it, and its MJCF."""
    seeds: int | None = None
    """At most so many of every row."""
    workers: int = os.cpu_count() or 1
    """Rows run side by side, each on one core."""
    work: Path = Path("runs/benchmark-preferences")
    """Directory of the runs."""
    results: Path = Path("docs/results/preferences")
    """Directory of the finished rows."""
    docs: Path = Path("docs")
    """Directory of benchmarks.md and images/, which get table and plot."""
    table_only: bool = False
    """Run nothing: publish the rows there are."""
    keep_runs: bool = False
    """Keep the run directories of finished rows."""
    quick: bool = False
    """A small version that shows that everything runs; its figures mean nothing."""
    json: Path | None = None
    """File for the rows, seeds put together."""


def end_with(parent: int) -> None:
    """End this process with `parent`: a killed benchmark leaves nothing running."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def run_cells(cells: list[Cell], options: Options) -> int:
    """Run all unfinished cells in processes of their own; gives how many failed."""
    places = Places(
        work=options.work,
        results=options.results,
        robot=options.robot[1] if options.robot else None,
        quick=options.quick,
    )
    places.results.mkdir(parents=True, exist_ok=True)
    failed = 0
    # Forked children would inherit torch's threads in an unknown state.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(
        options.workers,
        mp_context=context,
        initializer=end_with,
        initargs=(os.getpid(),),
    ) as pool:
        left = [cell for cell in cells if not places.result(cell).exists()]
        running = {pool.submit(run_cell, cell, places): cell for cell in left}
        for done, future in enumerate(as_completed(running), start=1):
            cell, error = running[future], future.exception()
            if error is None:
                console.print(f"{done} of {len(left)}: {cell.name}")
                if not options.keep_runs:
                    forget(cell, places)
                continue
            failed += 1
            trace = "".join(traceback.format_exception(error))
            console.print(f"{done} of {len(left)}: {cell.name} failed\n{trace}")
    return failed


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> int:
    """Run, publish; the exit code tells whether every row was finished."""
    for what, asked, known in (
        ("task", options.tasks, TASKS),
        ("method", options.methods, METHODS),
        ("rater", options.raters, RATERS),
    ):
        for name in asked:
            if name not in known:
                raise GaitprefError(
                    f"there is no {what} {name!r}; there are {', '.join(known)}"
                )
    failed = 0
    if not options.table_only:
        cells = plan(
            tasks=options.tasks,
            methods=options.methods,
            raters=options.raters,
            answers=options.answers,
            robot=options.robot[0] if options.robot else None,
            seeds=options.seeds,
        )
        if options.quick:
            cells = list({cell.task: cell for cell in reversed(cells)}.values())
        failed = run_cells(cells, options)
    publish_rows(read_rows(options.results), options.docs, options.json)
    return 1 if failed else 0


if __name__ == "__main__":
    try:
        sys.exit(main(tyro.cli(Options, config=(tyro.conf.OmitArgPrefixes,))))
    except GaitprefError as error:
        sys.exit(f"benchmarks.preferences: {error}")
