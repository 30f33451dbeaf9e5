"""Rows of a sweep put together: means over seeds, as a table, as CSV and as JSON."""

from __future__ import annotations

import csv
import io
import json
import statistics
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from gaitpref.report.seed_intervals import SeedMean

from .run_sweep import SweepResult
from .sweep_cell import SweepRow
from .sweep_plan import SEED, value_text

FIGURES = {
    "final_return": "return",
    "gained": "gained",
    "tracking_error_m_s": "off by, m/s",
}
"""What means are made of, and what they are called."""


@dataclass(frozen=True, kw_only=True)
class SweepMean:
    """Cells that differ by their seed only, as one."""

    settings: Mapping[str, Any]
    """All that is varied but the seed."""
    rows: tuple[SweepRow, ...]
    """One for each seed."""

    def figure(self, name: str) -> SeedMean:
        """The mean of one of `FIGURES`."""
        return SeedMean.of([getattr(row, name) for row in self.rows])

    @property
    def verdicts(self) -> dict[str, int]:
        """How often the runs said what of themselves; of those that did."""
        return dict(Counter(row.verdict for row in self.rows if row.verdict))

    @property
    def verdict(self) -> str:
        """How many said that they ended better."""
        said = sum(self.verdicts.values())
        return f"{self.verdicts.get('better', 0)} of {said}" if said else "-"

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "settings": dict(self.settings),
            "seeds": [row.settings[SEED] for row in self.rows],
            "verdicts": self.verdicts,
            "answers": [row.answers for row in self.rows],
            **{name: asdict(self.figure(name)) for name in FIGURES},
        }


def means(rows: Sequence[SweepRow]) -> list[SweepMean]:
    """The rows, seeds put together, in the order in which groups come first."""
    groups: dict[tuple[Any, ...], list[SweepRow]] = defaultdict(list)
    for row in rows:
        groups[row.group].append(row)
    return [
        SweepMean(
            settings={n: v for n, v in own[0].settings.items() if n != SEED},
            rows=tuple(own),
        )
        for own in groups.values()
    ]


def heads(groups: Sequence[SweepMean]) -> list[str]:
    """The columns of `cells_of`."""
    varied = groups[0].settings if groups else ()
    short = (name.rpartition(".")[2] for name in varied)
    return [*short, "seeds", *FIGURES.values(), "better", "answers"]


def cells_of(group: SweepMean) -> list[str]:
    """One line of the table."""
    return [
        *map(value_text, group.settings.values()),
        str(len(group.rows)),
        *(str(group.figure(name)) for name in FIGURES),
        group.verdict,
        f"{statistics.fmean(row.answers for row in group.rows):.0f}",
    ]


def as_csv(rows: Sequence[SweepRow]) -> str:
    """One line for every finished cell."""
    text = io.StringIO()
    if rows:
        lines = [
            {name: value_text(v) for name, v in row.settings.items()}
            | {n: v for n, v in asdict(row).items() if n not in ("name", "settings")}
            | {"cell": row.name}
            for row in rows
        ]
        writer = csv.DictWriter(text, lines[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(lines)
    return text.getvalue()


def as_json(result: SweepResult) -> str:
    """Everything there is: rows, means and their intervals, failures."""
    found = {
        "interval": "95 % of Student's t over seeds",
        "means": [group.as_json() for group in means(result.rows)],
        "rows": [asdict(row) for row in result.rows],
        "failures": result.failures,
    }
    return json.dumps(found, indent=1)
