"""Make the walking policy that ships: `python -m benchmarks.shipped_walk`.

It is the base of the benchmark's styles, so that what docs/benchmarks.md says of a
style holds for who begins with it.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from data.errors import GaitprefError
from data.files.files import sha256_file, write_atomically
from policy.robots.shipped import WALK
from policy.training.checkpoint import without_optimizer

from .preference_plan import Cell
from .preference_row import Places, walking_base

_ANY_STYLE = Cell(task="crouch", answers=20, rater="perfect", method="default", seed=0)


@dataclass(frozen=True, kw_only=True)
class ShippedWalk:
    """Train the walk, a minute or two, and write it."""

    work: Path = Path("runs/benchmark-preferences")
    """Directory of the training, which is gone on with or taken as it is."""
    out: Path = WALK
    """The file."""


def main(options: ShippedWalk) -> int:
    """Train and write."""
    places = Places(work=options.work, results=options.work)
    trained = walking_base(_ANY_STYLE, places)
    write_atomically(options.out, without_optimizer(trained))
    print(f"{options.out}: {sha256_file(options.out)}")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main(tyro.cli(ShippedWalk)))
    except GaitprefError as error:
        sys.exit(f"benchmarks.shipped_walk: {error}")
