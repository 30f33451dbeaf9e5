"""What each decision of the method is worth: the loop with it and without it.

`python -m benchmarks.ablations` takes days on two cores and can be interrupted
anywhere, as `benchmarks.preferences` can, whose rows these are compared with.
`--table-only` writes the table of the rows there are into docs/method.md, and what all
runs said at their end into docs/benchmarks.md.
"""

from __future__ import annotations

import math
import statistics
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from data.errors import GaitprefError

from . import preference_table, verdict_table
from .marks import write_between
from .preference_plan import Cell
from .preference_table import Row, read_rows
from .preferences import Options, run_cells

Place = tuple[str, int, str]
"""Task, answers, rater."""

WALKS: tuple[Place, ...] = (("walk", 100, "perfect"), ("walk", 100, "mistakes20"))
STYLES: tuple[Place, ...] = (("trot", 20, "perfect"), ("high_step", 20, "perfect"))
ERRING: tuple[Place, ...] = (
    ("trot", 60, "mistakes20"),
    ("high_step", 60, "mistakes20"),
)
RATE: tuple[Place, ...] = (("low_energy", 20, "perfect"), ("trot", 60, "perfect"))
POSTURE: tuple[Place, ...] = (("crouch", 20, "perfect"), ("lean", 20, "perfect"))
WEIGHT: tuple[Place, ...] = tuple(
    (task, 20, "perfect") for task in ("trot", "high_step", "low_energy", "crouch")
)
ABLATIONS: tuple[tuple[str, tuple[Place, ...]], ...] = (
    ("disagreeing", STYLES),
    ("unjudged", STYLES),
    ("linear", STYLES),
    ("no-calm", (*STYLES, *RATE)),
    ("no-limit", STYLES),
    ("no-posture", POSTURE),
    ("no-earlier", STYLES),
    ("unjudged", ERRING),
    ("weight-1", WEIGHT),
    ("no-mirror", (*STYLES, *WALKS)),
    ("no-hope", (*WALKS, ("walk", 40, "perfect"))),
    ("unjudged", WALKS),
    ("no-earlier", WALKS),
    ("no-rhythms", WALKS),
    ("no-posture", WALKS),
    ("no-caution", (("walk", 100, "mistakes20"), ("brisk_walk", 100, "mistakes20"))),
    ("not-told", (("walk", 100, "mistakes20"), ("brisk_walk", 100, "mistakes20"))),
    ("not-steady", WALKS),
    ("keep-noise", WALKS),
    ("not-sure", (("walk", 100, "perfect"), ("walk", 40, "perfect"))),
    ("trusting", (("walk", 100, "mistakes20"), ("brisk_walk", 100, "mistakes20"))),
    ("even", (*STYLES, *WALKS)),
    ("half-noisy", WALKS),
)
"""What is left out, and where; in the order of running."""
LEFT_OUT = {
    "disagreeing": "questions by what they tell",
    "unjudged": "answers that judge policies",
    "linear": "the posterior over habits",
    "no-calm": "noise that comes down where the rate of steps is paid",
    "no-limit": "the price of following commands worse",
    "no-posture": "clips in another posture",
    "no-earlier": "clips of earlier policies",
    "weight-1": "weight 3 beside the task",
    "no-mirror": "steps in the mirror",
    "no-hope": "optimism where a robot stands still",
    "no-rhythms": "clips of random rhythms",
    "no-caution": "caution where answers err",
    "not-told": "strong opinions about commands",
    "not-steady": "unsteady walks disliked before any answer",
    "keep-noise": "the schedule of exploration noise",
    "not-sure": "only what is surely liked is paid",
    "trusting": "whether answers err is found out",
    "even": "many answers in the first round",
    "half-noisy": "every clip from scratch with exploration noise",
}
"""What each method lacks, and has instead."""
KEPT_FOR = {
    "unjudged": "verdicts rest on it",
    "no-limit": "commands are followed",
}
"""Why a decision stays whose rows alone would not keep it."""
PAGE = "method.md"
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
    whole: Path = Path("docs/results/preferences")
    """Directory of rows of `benchmarks.preferences`, which lack nothing."""
    docs: Path = Path("docs")
    """Directory of method.md, which gets the table."""
    table_only: bool = False
    """Run nothing: write the tables of the rows there are."""


def cells(only: tuple[str, ...] = ()) -> list[Cell]:
    """All rows, in the order of running."""
    return [
        Cell(task=task, answers=answers, rater=rater, method=method, seed=seed)
        for method, places in ABLATIONS
        if not only or method in only
        for seed in range(SEEDS)
        for task, answers, rater in places
    ]


@dataclass(frozen=True, kw_only=True)
class Worth:
    """What a decision was worth: differences of rows with it and without it."""

    method: str
    """Name of the method without it."""
    places: tuple[str, ...]
    shares: tuple[float, ...]
    """Share of the true reward, with minus without, of every pair of rows."""
    errors_m_s: tuple[float, ...]
    """Tracking error likewise."""

    @property
    def mean(self) -> float:
        return statistics.fmean(self.shares)

    @property
    def standard_error(self) -> float:
        """Standard error of the mean; infinite for fewer than two pairs."""
        if len(self.shares) < 2:
            return math.inf
        return statistics.stdev(self.shares) / math.sqrt(len(self.shares))

    @property
    def pairs(self) -> str:
        """How many there are, and of how many the two rows are the same run: there the
        decision never came into play."""
        unmoved = sum(
            (share, error) == (0.0, 0.0)
            for share, error in zip(self.shares, self.errors_m_s, strict=True)
        )
        return f"{len(self.shares)}" + (f", {unmoved} alike" if unmoved else "")

    @property
    def told(self) -> str:
        """The mean, with its standard error where there is one."""
        beside = "" if len(self.shares) < 2 else f" ± {self.standard_error:.3f}"
        return f"{self.mean:+.3f}{beside}"

    @property
    def verdict(self) -> str:
        """What the rows say of the decision."""
        if len(self.shares) < 2 * SEEDS:
            return f"open: {len(self.shares)} of {2 * SEEDS} pairs"
        if self.mean > self.standard_error:
            return "stays"
        reason = KEPT_FOR.get(self.method)
        return f"stays: {reason}" if reason else "leaves"


def worths(rows: Sequence[Row]) -> list[Worth]:
    """What every decision is worth that has rows with it and without it, both of which
    began with the same walk."""
    by_key = {(row["method"], *_begun(row)): row for row in rows}
    found = []
    for method in dict.fromkeys(name for name, _ in ABLATIONS):
        pairs = [
            (place, by_key["default", place, seed, start], row)
            for (name, place, seed, start), row in sorted(by_key.items())
            if name == method and ("default", place, seed, start) in by_key
        ]
        if pairs:
            found.append(
                Worth(
                    method=method,
                    places=tuple(dict.fromkeys(place for place, _, _ in pairs)),
                    shares=tuple(a["fraction"] - b["fraction"] for _, a, b in pairs),
                    errors_m_s=tuple(
                        a["tracking_error_m_s"] - b["tracking_error_m_s"]
                        for _, a, b in pairs
                    ),
                )
            )
    return found


def _begun(row: Row) -> tuple[str, int, float]:
    """Task, answers and rater of a row, its seed, and what it began with."""
    rater = "" if row["rater"] == "perfect" else f" {row['rater']}"
    place = f"{row['task']} {row['answers']}{rater}"
    return place, row["seed"], round(row["start_return"], 3)


def markdown(found: Sequence[Worth]) -> str:
    """The table of what decisions are worth."""
    if not found:
        return "No decision of the present method has rows yet."
    lines = [
        "| left out | on | pairs | difference of shares | of errors | verdict |",
        "|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {LEFT_OUT[each.method]} (`{each.method}`) | {', '.join(each.places)} "
        f"| {each.pairs} | {each.told} "
        f"| {statistics.fmean(each.errors_m_s):+.3f} m/s | {each.verdict} |"
        for each in found
    ]
    known = {each.method for each in found}
    lines += [
        f"| {LEFT_OUT[name]} (`{name}`) | | 0 | | | open |"
        for name in dict.fromkeys(name for name, _ in ABLATIONS)
        if name not in known
    ]
    return "\n".join(lines)


def publish(rows: Sequence[Row], docs: Path) -> None:
    """Write what decisions are worth into its page, and print it."""
    table = markdown(worths(rows))
    print(table)
    write_between(docs / PAGE, "ablations", table)


def publish_verdicts(rows: Sequence[Row], docs: Path) -> None:
    """Write what runs said at their end into its page, and print it."""
    table = verdict_table.markdown(verdict_table.ended(rows))
    print(table)
    write_between(docs / preference_table.PAGE, "verdicts", table)


def main(options: Annotated[Ablations, tyro.conf.FlagCreatePairsOff]) -> int:
    """Run, publish; the exit code tells whether every row was finished."""
    run = Options(work=options.work, results=options.results, workers=options.workers)
    failed = 0 if options.table_only else run_cells(cells(options.only), run)
    # Of two that lack nothing the one beside the others is of the version they are of.
    rows = [*read_rows(options.whole), *read_rows(options.results)]
    publish(rows, options.docs)
    publish_verdicts(rows, options.docs)
    return 1 if failed else 0


if __name__ == "__main__":
    try:
        sys.exit(main(tyro.cli(Ablations)))
    except GaitprefError as error:
        sys.exit(f"benchmarks.ablations: {error}")
