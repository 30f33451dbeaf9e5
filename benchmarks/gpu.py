"""What `--device cuda` is worth, and whether it does what the CPU does.

    python -m benchmarks.gpu [--device cpu] [--quick] [--parts NAME ...]

Checks come first: features against MuJoCo's on the CPU, resets of some robots, robots
that diverge. Then steps per second of the bare simulator, of the environment and of PPO
from end to end, memory, and, of two seeds, the time from nothing to what `evaluate`
calls a walk. Every part writes its row, with the name of the card, as soon as it is
known; `python -m benchmarks.gpu_table` puts them into `docs/benchmarks.md`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Annotated

import tyro

from .gpu_bench import Bench, Options, Part
from .gpu_checks import diverged, parity, reset
from .gpu_speed import bare, environment, first, ppo, profile, walk

DONE_BY: dict[Part, Callable[[Bench], None]] = {
    "first": first,
    "parity": parity,
    "reset": reset,
    "diverged": diverged,
    "bare": bare,
    "env": partial(environment, varied=False),
    "varied": partial(environment, varied=True),
    "ppo": ppo,
    "walk": walk,
    "profile": profile,
}


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> None:
    """Do the parts in turn."""
    if options.quick:
        options = replace(
            options, sizes=(64,), envs=64, turn_s=0.5, iterations=2, walk_s=10.0
        )
    bench = Bench(options)
    for part in options.parts:
        start_s = time.perf_counter()
        DONE_BY[part](bench)
        print(f"{part}: {time.perf_counter() - start_s:.1f} s in all", flush=True)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
