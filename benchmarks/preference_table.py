"""From finished rows to a table, a plot and one JSON file."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib

from data.files.files import write_atomically

from .harness import median
from .marks import between, write_between

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes

PAGE = "benchmarks.md"
PLOT = "images/preferences.svg"
MARK, EARLIER = "preferences", "earlier"
"""Marks around what is replaced in the page."""

Row = dict[str, Any]
KEY = ("task", "robot", "answers", "rater", "method")
"""What makes rows one; without a robot it is the one that ships."""


def read_rows(results: Path) -> list[Row]:
    """Every finished row, one a seed, in the order of their names."""
    return [json.loads(path.read_text()) for path in sorted(results.glob("*.json"))]


def together(rows: Sequence[Row]) -> list[Row]:
    """Rows that differ by their seed only, as one; medians where not said otherwise."""
    groups: dict[tuple[Any, ...], list[Row]] = defaultdict(list)
    for row in rows:
        groups[_key(row)].append(row)
    return [
        dict(zip(KEY, key, strict=True))
        | {
            "seeds": len(group),
            "fraction_median": median([row["fraction"] for row in group]),
            "fraction_min": min(row["fraction"] for row in group),
            "fraction_max": max(row["fraction"] for row in group),
            "tracking_error_added_m_s": median(
                [row["tracking_error_m_s"] - row["start_tracking_error_m_s"]
                 for row in group]
            ),
            "accuracy": _median_of_known(group, "accuracy"),
            "at_random_accuracy": _median_of_known(group, "at_random_accuracy"),
            "ece": _median_of_known(group, "ece"),
            "fresh_accuracy": _median_of_known(group, "fresh_accuracy"),
            "fresh_ece": _median_of_known(group, "fresh_ece"),
            "verdicts": _verdicts(group),
            "minutes": _median_of_known(group, "minutes"),
        }
        for key, group in groups.items()
    ]  # fmt: skip


def _key(row: Row) -> tuple[Any, ...]:
    return tuple(row.get(name) for name in KEY)


def _verdicts(rows: Sequence[Row]) -> str:
    """How often a run said it ended better, of the runs that did, and how often of the
    others."""
    said = [row for row in rows if row.get("verdict")]
    if not said:
        return "-"
    told = []
    for name, ended in (("better", True), ("worse", False)):
        own = [row for row in said if (row["return"] > row["start_return"]) == ended]
        if own:
            better = sum(row["verdict"] == "better" for row in own)
            told.append(f"{better} of {len(own)} {name}")
    return ", ".join(told)


def _median_of_known(rows: Sequence[Row], name: str) -> float | None:
    known = [row[name] for row in rows if row.get(name) is not None]
    return median(known) if known else None


def markdown(rows: Sequence[Row]) -> str:
    """The table of `together`'s rows; without a verdict where no row has one."""
    table = [
        {
            "row": _name(row)
            + ("" if row["method"] == "default" else f", {row['method']}"),
            "seeds": str(row["seeds"]),
            "fraction: median (min to max)": _spread(row),
            "tracking error added": f"{row['tracking_error_added_m_s']:+.2f}",
            "held out: accuracy, of pairs at random, ECE": f"{_shown(row['accuracy'])}"
            f", {_shown(row['at_random_accuracy'])}, {_shown(row['ece'], 3)}",
            "fresh pairs: accuracy, ECE": f"{_shown(row['fresh_accuracy'])}, "
            f"{_shown(row['fresh_ece'], 3)}",
            "called better": row["verdicts"],
            "minutes": _shown(row["minutes"], 1),
        }
        for row in rows
    ]
    if not table:
        return "No row is finished."
    columns = list(table[0])
    if all(line["called better"] == "-" for line in table):
        columns = [name for name in columns if name != "called better"]
    lines = [columns, *([line[name] for name in columns] for line in table)]
    head, *body = (f"| {' | '.join(cells)} |" for cells in lines)
    return "\n".join([head, "|" + "---|" * len(columns), *body])


def _spread(row: Row) -> str:
    middle = f"{row['fraction_median']:.2f}"
    if row["seeds"] == 1:
        return middle
    return f"{middle} ({row['fraction_min']:.2f} to {row['fraction_max']:.2f})"


def _task(row: Row) -> str:
    return row["task"] if row["robot"] is None else f"{row['task']}, {row['robot']}"


def _shown(value: float | None, digits: int = 2) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _bar(row: Row) -> tuple[float, tuple[float, float]]:
    """Median of a row, and how far the worst and the best seed are from it."""
    middle = row["fraction_median"]
    return middle, (middle - row["fraction_min"], row["fraction_max"] - middle)


def plot(rows: Sequence[Row], path: Path) -> None:
    """Fraction of every row, bars from worst to best seed: against answers for tasks
    with several budgets, a line each for all others."""
    by_task: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        by_task[_task(row)].append(row)
    several = [
        task
        for task, own in by_task.items()
        if len({row["answers"] for row in own}) > 1
    ]
    alone = [row for row in rows if _task(row) not in several]
    panels = len(several) + bool(alone)
    height = max(4.2, 0.3 * len(set(map(_name, alone))) + 0.8)
    size = (5.2 * panels, height)
    figure, axes = plt.subplots(1, panels, figsize=size, squeeze=False)
    for axis, task in zip(axes.flat, several, strict=False):
        _against_answers(axis, task, by_task[task])
    if alone:
        _one_line_each(axes.flat[-1], alone)
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    # Without a date and with fixed ids, equal rows give equal files.
    with plt.rc_context({"svg.hashsalt": "preferences"}):
        figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


def _against_answers(axis: Axes, task: str, rows: Sequence[Row]) -> None:
    series: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        series[f"{row['rater']}, {row['method']}"].append(row)
    for label, own in series.items():
        own.sort(key=lambda row: row["answers"])
        answers = [row["answers"] for row in own]
        middle, reach = zip(*map(_bar, own), strict=True)
        reach = tuple(zip(*reach, strict=True))
        axis.errorbar(answers, middle, reach, marker="o", capsize=3, label=label)
    for level, style in ((1.0, "-"), (0.0, ":")):
        axis.axhline(level, color="0.6", linewidth=0.8, linestyle=style)
    axis.set(title=task, xlabel="answers", ylabel="fraction of the true reward")
    axis.legend(fontsize=7, loc="lower left")


def _one_line_each(axis: Axes, rows: Sequence[Row]) -> None:
    """A line for all methods of a task, those beside the usual one below it."""
    names = list(dict.fromkeys(map(_name, reversed(rows))))
    methods = sorted({row["method"] for row in rows} - {"default"})
    if any(row["method"] == "default" for row in rows):
        methods.insert(0, "default")
    for number, method in enumerate(methods):
        own = [row for row in rows if row["method"] == method]
        places = [names.index(_name(row)) - 0.25 * number for row in own]
        middle, reach = zip(*map(_bar, own), strict=True)
        axis.errorbar(
            middle, places, xerr=tuple(zip(*reach, strict=True)),
            marker="o", markersize=5, capsize=3, linestyle="", label=method,
        )  # fmt: skip
    for level, style in ((1.0, "-"), (0.0, ":")):
        axis.axvline(level, color="0.6", linewidth=0.8, linestyle=style)
    axis.set_yticks(range(len(names)), names)
    axis.set(xlabel="fraction of the true reward")
    if len(methods) > 1:
        axis.legend(fontsize=7, loc="lower left")


def _name(row: Row) -> str:
    """Task, answers and rater of a row; a perfect rater is not said."""
    told = [_task(row), f"{row['answers']} answers"]
    return ", ".join(told + ([row["rater"]] if row["rater"] != "perfect" else []))


def publish_rows(
    rows: Sequence[Row],
    docs: Path,
    json_file: Path | None,
    *,
    earlier: Sequence[Row] = (),
) -> None:
    """Write table and plot into the docs, print the table, write the JSON file.

    Args:
        rows: Of the present version.
        docs: Where the page is.
        json_file: Where they are written too.
        earlier: Of versions before; of them those are told that were not run again.
    """
    if not rows:
        print("there is no finished row")
        return
    summary = together(rows)
    table = markdown(summary)
    print(table)
    plot(summary, docs / PLOT)
    page = docs / PAGE
    if not page.exists():
        both = between(MARK, "") + between(EARLIER, "")
        write_atomically(page, both.encode())
    write_between(page, MARK, f"{table}\n\n![Fraction against answers]({PLOT})")
    if earlier:
        again = set(map(_key, summary))
        left = [row for row in together(earlier) if _key(row) not in again]
        write_between(page, EARLIER, markdown(left))
    if json_file is not None:
        content = json.dumps({"rows": summary}, indent=1) + "\n"
        write_atomically(json_file, content.encode())
