"""Does it learn what the rater wants: tasks x answers x raters x methods x seeds.

`python -m benchmarks.preferences` takes hours on two cores and can be interrupted
anywhere: a finished row is a file in `--results`, and an unfinished one goes on.
"""

from __future__ import annotations

import sys
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from data.errors import GaitprefError
from gaitpref.console.progress import console, counting_bar
from gaitpref.executor.choose_executor import choose_executor, cores_each
from gaitpref.executor.pieces import Piece

from .preference_plan import FIGURES, METHODS, RATERS, TASKS, Cell, plan
from .preference_row import Places, forget, run_cell
from .preference_table import publish_rows, read_rows


@dataclass(frozen=True, kw_only=True)
class Options:
    """Run what is not finished, then write table, plots and JSON from all rows."""

    tasks: tuple[str, ...] = ()
    """Only these; by default all but the one that is held back."""
    methods: tuple[str, ...] = ()
    """Only these; by default the loop as it is."""
    raters: tuple[str, ...] = ()
    """Only these; by default all."""
    figure: str | None = None
    """Rows of a figure in place of those that run by default: `answers`, `erring`,
    `peers` or `rates`. Days on two cores; --tasks, --raters, --answers, --methods and
    --seeds choose among them."""
    answers: tuple[int, ...] = ()
    """Only rows with so many answers; by default all."""
    robot: tuple[str, Path] | None = None
    """Another robot than the one that ships: a name for it, and its MJCF; or a name
    for a policy that was imported, and its policy.pt, as the base of styles."""
    seeds: int | None = None
    """At most so many of every row."""
    workers: int | None = None
    """Rows run side by side, which share the cores; by default one a core."""
    ray: str | None = None
    """In place of processes: HOST:PORT of a Ray cluster that runs them, `auto` for the
    one that runs here, `local` for one of this machine's cores."""
    work: Path = Path("runs/benchmark-preferences")
    """Directory of the runs."""
    results: Path = Path("docs/results/preferences")
    """Directory of the finished rows."""
    references: Path = Path("docs/results/references")
    """Directory of what rows are measured against, trained once a task and base."""
    earlier: Path = Path("docs/results/earlier")
    """Directory of rows of earlier versions, of which the page tells those that were
    not run again."""
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


def run_cells(cells: list[Cell], options: Options) -> int:
    """Run all unfinished cells; gives how many failed."""
    places = Places(
        work=options.work,
        results=options.results,
        robot=options.robot[1] if options.robot else None,
        references=None if options.quick else options.references,
        quick=options.quick,
    )
    places.results.mkdir(parents=True, exist_ok=True)
    unfinished = [cell for cell in cells if not places.result(cell).exists()]
    cores = cores_each(len(unfinished), jobs=options.workers, ray=options.ray)
    left = [
        Piece(
            name=cell.name,
            function=run_cell,
            args=(cell, places),
            log=places.log(cell),
            cores=cores,
        )
        for cell in unfinished
    ]
    of_name = {cell.name: cell for cell in cells}
    executor = choose_executor(jobs=options.workers, ray=options.ray)
    failed = 0
    with (
        closing(executor.outcomes(left)) as outcomes,
        counting_bar("rows", len(left)) as bar,
    ):
        for done, outcome in enumerate(outcomes, start=1):
            bar.advance(bar.task_ids[0])
            name, failure = outcome.piece.name, outcome.failure
            if failure is None:
                console.print(f"{done} of {len(left)}: {name}")
                if not options.keep_runs:
                    forget(of_name[name], places)
                continue
            failed += 1
            log = places.log(of_name[name])
            console.print(
                f"{done} of {len(left)}: {name} failed: {failure.reason}; see {log}"
            )
    return failed


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> int:
    """Run, publish; the exit code tells whether every row was finished."""
    for what, asked, known in (
        ("task", options.tasks, TASKS),
        ("method", options.methods, METHODS),
        ("rater", options.raters, RATERS),
        ("figure", filter(None, (options.figure,)), FIGURES),
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
            figure=options.figure,
        )
        if options.quick:
            cells = list({cell.task: cell for cell in reversed(cells)}.values())
        failed = run_cells(cells, options)
    publish_rows(
        read_rows(options.results),
        options.docs,
        options.json,
        earlier=read_rows(options.earlier),
    )
    return 1 if failed else 0


if __name__ == "__main__":
    try:
        sys.exit(main(tyro.cli(Options, config=(tyro.conf.OmitArgPrefixes,))))
    except GaitprefError as error:
        sys.exit(f"benchmarks.preferences: {error}")
