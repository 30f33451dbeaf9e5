"""The rows of `python -m benchmarks.gpu` as a table in `docs/benchmarks.md`.

    python -m benchmarks.gpu_table [--rows DIR] [--page FILE]

A card is written beside every figure; what no device was had for is "not measured".
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from .harness import Figure
from .marks import NOT_MEASURED, write_between

MARK = "gpu"
_RATE, _SHARE, _TIME = "{:,.0f} steps/s", "{:.2%}", "{:.0f} s"
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("first", "make_s", "kernels compiled, once a machine", "{:.0f} s", ""),
    ("parity", "within_1e-3", "robots within 1e-3 after 50 steps", _SHARE, "99.9 %"),
    ("parity", "cpu_itself_within_1e-3", "the CPU's own, 1e-7 off", _SHARE, ""),
    ("parity", "decided_within_1e-3", "where no digit decides", _SHARE, "99.9 %"),
    ("parity", "contacts_alike", "feet on the ground alike", _SHARE, ""),
    ("reset", "others_alike", "a reset leaves the others alone", "{}", "True"),
    ("diverged", "sound", "a robot that diverged is ended", "{}", "True"),
    *(
        (f"{part}-{size}", "steps_per_s", f"{what}, {size:,} robots", _RATE, "")
        for part, what in (
            ("bare", "physics alone"),
            ("env", "environment"),
            ("varied", "environment, robots that differ"),
        )
        for size in (1024, 4096, 8192)
    ),
    ("ppo-4096", "steps_per_s", "PPO, 4,096 robots", _RATE, "400,000 steps/s"),
    ("ppo-4096", "used_mb", "memory of that", "{:,.0f} MB", ""),
    ("walk-0", "walk_s", "from nothing to a walk, seed 0", _TIME, "45 s"),
    ("walk-1", "walk_s", "from nothing to a walk, seed 1", _TIME, "45 s"),
)
"""File, figure, what it is, how it is written, and the goal."""
FILES = frozenset(row[0] for row in ROWS)


@dataclass(frozen=True, kw_only=True)
class Options:
    """Put the rows into the page."""

    rows: Path = Path("docs/results/gpu")
    """Directory of the rows."""
    page: Path = Path("docs/benchmarks.md")
    """Page with the two lines the table stands between."""


def table(rows: dict[str, dict[str, Figure]]) -> str:
    """The table in Markdown, of rows by the names of their files."""
    lines = ["| what | figure | goal | card |", "|---|---|---|---|"]
    for name, figure, what, form, goal in ROWS:
        row = rows.get(name, {})
        value = row.get(figure)
        told = NOT_MEASURED if value is None else form.format(value)
        lines.append(f"| {what} | {told} | {goal} | {row.get('card', '')} |")
    return "\n".join(lines)


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> None:
    """Read the rows and write the page."""
    rows = {
        path.stem: json.loads(path.read_text()) for path in options.rows.glob("*.json")
    }
    write_between(options.page, MARK, table(rows))


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
