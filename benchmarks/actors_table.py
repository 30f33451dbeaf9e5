"""The figures of `python -m benchmarks.actors` as a table in `docs/benchmarks.md`.

python -m benchmarks.actors_table [--figures FILE] [--page FILE]
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, get_args

import tyro

from .actors import GOALS
from .actors_run import Way
from .harness import Figure
from .marks import NOT_MEASURED, write_between

MARK = "actors"
COLUMNS: tuple[tuple[str, str, str], ...] = (
    ("steps/s", "steps_per_s", "{:,.0f}"),
    ("seeds", "seeds", "{:.0f}"),
    ("walk", "walked", "{:.0f}"),
    ("steps to a walk", "walk_steps", "{:,.0f}"),
    ("time to a walk", "walk_s", "{:,.0f} s"),
    ("lag", "lag_mean", "{:.2f}"),
    ("most", "lag_most", "{:.0f}"),
    ("clipped", "clipped_share", "{:.1%}"),
    ("dropped", "dropped", "{:.1%}"),
    ("bytes a step", "bytes_per_step", "{:,.0f}"),
)
"""What it is called, the figure, and how it is written."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Put the figures into the page."""

    figures: Path = Path("docs/results/actors.json")
    """What `python -m benchmarks.actors --json` wrote, if it did."""
    page: Path = Path("docs/benchmarks.md")
    """Page with the two lines the table stands between."""


def table(figures: Mapping[str, Figure]) -> str:
    """Both tables in Markdown: ways to train, and the ratios that goals are of."""
    names = [name for name in _names() if f"{name}_steps_per_s" in figures]
    lines = ["| engine | " + " | ".join(head for head, _, _ in COLUMNS) + " |"]
    lines.append("|---" * (len(COLUMNS) + 1) + "|")
    for name in names:
        cells = [
            _cell(figures, f"{name}_{figure}", form) for _, figure, form in COLUMNS
        ]
        lines.append(f"| {name.replace('_', ', ')} | " + " | ".join(cells) + " |")
    if not names:
        lines.append(f"| {NOT_MEASURED} |" + " |" * len(COLUMNS))
    lines += ["", "| ratio | seen | goal |", "|---|---|---|"]
    asked = dict.fromkeys([*GOALS, *(name for name in figures if "_over_" in name)])
    for name in asked:
        seen = _cell(figures, name, "{:.2f}") or NOT_MEASURED
        lines.append(f"| `{name}` | {seen} | {GOALS.get(name, '')} |")
    return "\n".join(lines)


def _names() -> list[str]:
    """All that may have been run, in the order of the ways."""
    counts = (1, 2, 4, 8, 16)
    return [
        name
        for way in get_args(Way)
        for name in (("ppo",) if way == "ppo" else (f"{way}_{n}" for n in counts))
    ]


def _cell(figures: Mapping[str, Figure], name: str, form: str) -> str:
    """A figure; empty where nobody asked, `none` where most seeds had none."""
    if name not in figures:
        return ""
    value = figures[name]
    return "none" if value is None else form.format(value)


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> None:
    """Read the figures and write the page."""
    there = options.figures.exists()
    figures = json.loads(options.figures.read_text()) if there else {}
    write_between(options.page, MARK, table(figures))


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
