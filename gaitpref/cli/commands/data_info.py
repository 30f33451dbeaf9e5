"""`gaitpref data info`: what is in a data set; needs no torch and no simulator."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict

from rich.table import Table

from data.datasets.dataset import Dataset
from data.datasets.overview import Overview, overview
from gaitpref.cli.options import data_options as options
from gaitpref.cli.shared.dataset_argument import open_dataset
from gaitpref.cli.shared.next_of_answers import next_answers, next_fit, next_pairs
from gaitpref.cli.shared.policy_names import policy_names
from gaitpref.console.progress import console
from gaitpref.console.terminal import PlainConsole


def info(action: options.Info) -> None:
    """Print what is in the data set."""
    dataset = open_dataset(action)
    seen, names = overview(dataset), policy_names(dataset)
    if action.json:
        print(json.dumps(asdict(seen) | {"policy_names": names}))
        return
    out = PlainConsole()
    out.print(_totals(seen))
    out.print(*_tables(seen, names), sep="\n")
    console.next(_next_of(seen, dataset))


def _totals(seen: Overview) -> Table:
    table = Table(show_header=False)
    for name in ("episodes", "steps", "bytes", "falls", "aborted", "pairs"):
        table.add_row(name, f"{getattr(seen, name):,}")
    table.add_row("hours of robot time", f"{seen.hours:.2f}")
    table.add_row("answers", f"{sum(count.answers for count in seen.answers):,}")
    return table


def _tables(seen: Overview, names: Mapping[str, str]) -> Iterator[Table]:
    """What was counted apart; nothing of what there is none of."""
    policies = Table("policy", "hash", "episodes")
    for sha256, name in names.items():
        policies.add_row(name, sha256[:12], f"{seen.policies[sha256]:,}")
    answers = Table("rater", "round", "answers", "preferences")
    for count in seen.answers:
        answers.add_row(*map(str, asdict(count).values()))
    tables = (
        _counts("robot", seen.robots),
        _counts("task", seen.tasks),
        policies,
        _counts("command (forward, left m/s, yaw rad/s)", seen.commands),
        answers,
    )
    return (table for table in tables if table.row_count)


def _counts(title: str, counts: Mapping[str, int]) -> Table:
    table = Table(title, "episodes")
    for name, count in counts.items():
        table.add_row(name, f"{count:,}")
    return table


def _next_of(seen: Overview, dataset: Dataset) -> str:
    if not seen.episodes:
        return f"`gaitpref record --dataset {dataset.root}` adds episodes"
    if not seen.pairs:
        return next_pairs(dataset)
    if not seen.answers:
        return next_answers(dataset)
    return next_fit(dataset)
