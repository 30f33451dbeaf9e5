"""What each decision of the method is worth: the loop with it and without it.

`python -m benchmarks.ablations` takes days on two cores and can be interrupted
anywhere, as `benchmarks.preferences` can, whose rows these are.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from data.errors import GaitprefError

from .preference_plan import Cell
from .preferences import Options, run_cells

Place = tuple[str, int, str]
"""Task, answers, rater."""

WALKS: tuple[Place, ...] = (("walk", 100, "perfect"), ("walk", 100, "mistakes20"))
STYLES: tuple[Place, ...] = (("trot", 60, "perfect"), ("high_step", 60, "perfect"))
ERRING: tuple[Place, ...] = (("high_step", 60, "mistakes20"),)
ABLATIONS: tuple[tuple[str, tuple[Place, ...]], ...] = (
    ("default", (*STYLES, *WALKS)),
    ("not-beyond", STYLES),
    ("unjudged", STYLES),
    ("lean", WALKS),
    ("from-last", STYLES),
    ("no-calm", STYLES),
    ("no-limit", STYLES),
    ("no-mirror", (*STYLES, *WALKS)),
    ("unjudged", WALKS),
    ("no-hope", WALKS),
    ("no-caution", (("walk", 100, "mistakes20"), ("brisk_walk", 100, "mistakes20"))),
    ("not-told", (("walk", 100, "mistakes20"), ("brisk_walk", 100, "mistakes20"))),
    ("no-posture", (*STYLES, *WALKS)),
    ("no-earlier", (*STYLES, *WALKS)),
    ("weight-1", STYLES),
    ("no-rhythms", WALKS),
    ("no-front", WALKS),
    ("keep-noise", WALKS),
    ("not-steady", WALKS),
    ("default", ERRING),
    ("unjudged", ERRING),
    ("default", (("brisk_walk", 100, "mistakes20"),)),
)
"""What is left out, and where; in the order of running."""
SEEDS = 3


@dataclass(frozen=True, kw_only=True)
class Ablations:
    """Run what is not finished."""

    only: tuple[str, ...] = ()
    """Only these."""
    workers: int = 2
    """Rows run side by side, each on one core."""
    work: Path = Path("runs/benchmark-preferences")
    """Directory of the runs."""
    results: Path = Path("docs/results/ablations")
    """Directory of the finished rows."""


def cells(only: tuple[str, ...] = ()) -> list[Cell]:
    """All rows, in the order of running."""
    return [
        Cell(task=task, answers=answers, rater=rater, method=method, seed=seed)
        for method, places in ABLATIONS
        if not only or method in only
        for seed in range(SEEDS)
        for task, answers, rater in places
    ]


def main(options: Annotated[Ablations, tyro.conf.FlagCreatePairsOff]) -> int:
    """Run; the exit code tells whether every row was finished."""
    run = Options(work=options.work, results=options.results, workers=options.workers)
    return 1 if run_cells(cells(options.only), run) else 0


if __name__ == "__main__":
    try:
        sys.exit(main(tyro.cli(Ablations)))
    except GaitprefError as error:
        sys.exit(f"benchmarks.ablations: {error}")
