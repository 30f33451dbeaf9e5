"""Who earned what a team got, as `gaitpref team shares` prints it."""

from __future__ import annotations

import json
import math
from dataclasses import asdict

from rich.table import Table

from gaitpref.cli.options.team_options import TeamShares
from gaitpref.console.progress import console
from gaitpref.console.terminal import PlainConsole
from gaitpref.team.team_credit import Credit, mean_credit, verdict_of


def tell_shares(command: TeamShares, credits: list[Credit], lazy: list[int]) -> None:
    """Print who earned what: of all episodes, and of those with a lazy robot."""
    verdict = verdict_of(credits)
    on_purpose = {
        who: [each for each, own in zip(credits, lazy, strict=True) if own == who]
        for who in (0, 1, 2)
    }
    if command.json:
        told = {
            "episodes": len(credits),
            "verdict": asdict(verdict)
            | {
                # One episode has no error, and JSON no infinity.
                "error": verdict.error if math.isfinite(verdict.error) else None,
                "sentence": verdict.sentence,
            },
            "mean": asdict(mean_credit(credits)),
            "lazy_on_purpose": {
                who: {
                    "mean": asdict(mean_credit(own)),
                    "verdict": verdict_of(own).sentence,
                }
                for who, own in on_purpose.items()
                if own
            },
        }
        print(json.dumps(told))
        return
    table = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False)
    for head in ("episodes", "robot", "share/s", "own/s", "worth/s", "stands"):
        table.add_column(head, justify="left" if head == "episodes" else "right")
    names: dict[int, str] = {0: "both walk", 1: "1 is lazy", 2: "2 is lazy"}
    for who, own in on_purpose.items():
        if not own:
            continue
        mean = mean_credit(own)
        for robot in (0, 1):
            table.add_row(
                f"{len(own)} {names[who]}" if robot == 0 else "",
                str(robot + 1),
                *(f"{part[robot]:+.2f}" for part in (mean.share, mean.own, mean.worth)),
                f"{mean.still[robot]:.0%}",
            )
    out = PlainConsole()
    out.print(table)
    for who, own in on_purpose.items():
        if own:
            out.print(f"{names[who]}: {verdict_of(own).sentence}")
    console.next(
        f"`gaitpref team train --reward {command.reward} --out NEW` pays each robot "
        "its share"
    )
