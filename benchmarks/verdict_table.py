"""What runs said of themselves at their end, beside how they did end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

from gaitpref.report.verdict import Word

from .preference_table import KEY, Row

WORDS: tuple[Word, ...] = get_args(Word)


@dataclass(frozen=True, kw_only=True)
class Ended:
    """Runs of one kind that ended alike."""

    name: str
    rows: tuple[Row, ...]

    def said(self, word: Word) -> int:
        return sum(row["verdict"] == word for row in self.rows)

    @property
    def alarms(self) -> str:
        """How many raised one, of those that tell."""
        told = [row["alarms"] for row in self.rows if row.get("alarms") is not None]
        return f"{sum(map(bool, told))} of {len(told)}" if told else "-"


def ended(rows: Sequence[Row]) -> list[Ended]:
    """Rows that have a verdict, each once, by method and by how they ended: with a
    larger true return than they started from, or not."""
    kept = {
        (
            row["seed"],
            round(row["start_return"], 3),
            *(row.get(name) for name in KEY),
        ): row
        for row in rows
        if row.get("verdict")
    }
    found = []
    for method, default in (
        ("the loop as it is", True),
        ("with a decision left out", False),
    ):
        for end, better in (("better", True), ("equal or worse", False)):
            own = tuple(
                row
                for row in kept.values()
                if (row["method"] == "default") == default
                and (row["return"] > row["start_return"]) == better
            )
            found.append(Ended(name=f"{method}, ended {end}", rows=own))
    return found


def markdown(found: Sequence[Ended]) -> str:
    """The table, and how many of the decided are right."""
    said = " | ".join(f"said {word}" for word in WORDS)
    lines = [
        f"| runs | number | {said} | raised an alarm |",
        "|" + "---|" * (3 + len(WORDS)),
    ]
    lines += [
        f"| {each.name} | {len(each.rows)} | "
        f"{' | '.join(str(each.said(word)) for word in WORDS)} | {each.alarms} |"
        for each in found
    ]
    rows = [
        (row, row["return"] > row["start_return"])
        for each in found
        for row in each.rows
    ]
    decided = [(row, better) for row, better in rows if row["verdict"] != "not known"]
    right = sum((row["verdict"] == "better") == better for row, better in decided)
    lines += [
        "",
        f"Of {len(rows)} runs {len(decided)} were decided, {right} of these rightly.",
    ]
    return "\n".join(lines)
