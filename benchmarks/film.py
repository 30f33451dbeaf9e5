"""What a film costs: `python -m benchmarks.film [--quick] [--json FILE]`.

The shipped walk beside itself, as the command writes it. The clock is worth something
on idle cores only; processor time is on others too.
"""

from __future__ import annotations

import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from data.errors import GaitprefError
from policy.robots.shipped import WALK

from .harness import Figure, gaitpref, others_at_work, publish

GOAL_S = 20.0
"""For 10 s of two robots, on two cores that have nothing else to do."""
_QUICK_S = 1.0


@dataclass(frozen=True, kw_only=True)
class FilmOptions:
    """Film two robots and take the time of the whole command."""

    duration_s: float = 10.0
    """Length of the film."""
    kinds: tuple[Literal["webp", "mp4", "gif"], ...] = ("webp", "mp4")
    """Endings of the files."""
    quick: bool = False
    """Film 1 s, to see that it works."""
    json: Path | None = None
    """File for the figures."""


def main(options: FilmOptions) -> int:
    """Film, print and write the figures."""
    duration_s = _QUICK_S if options.quick else options.duration_s
    figures: dict[str, Figure] = {
        "film_s": duration_s,
        "cores": os.cpu_count(),
        "others_at_work": others_at_work(),
    }
    for kind in options.kinds:
        figures |= {f"{kind}_{name}": value for name, value in _cost(kind, duration_s)}
    goals = {f"{kind}_wall_s": f"at most {GOAL_S:g}" for kind in options.kinds}
    publish("a film of two robots", figures, goals, options.json)
    return 0


def _cost(kind: str, duration_s: float) -> list[tuple[str, Figure]]:
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / f"both.{kind}"
        policies = ("--policy", WALK, "--against", WALK)
        length = ("--duration-s", str(duration_s))
        ran = gaitpref("film", *policies, *length, "--out", out)
        return [
            ("wall_s", round(ran.wall_s, 1)),
            ("cpu_s", round(ran.cpu_s, 1)),
            ("peak_mb", round(ran.peak_mb)),
            ("kb", round(out.stat().st_size / 1e3)),
        ]


if __name__ == "__main__":
    try:
        sys.exit(main(tyro.cli(FilmOptions)))
    except GaitprefError as error:
        sys.exit(f"benchmarks.film: {error}")
