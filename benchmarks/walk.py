"""How long `gaitpref train --reward task` takes from nothing to a robot that walks.

    python -m benchmarks.walk [--quick] [--json FILE]

One command a seed, from its start, imports included. It keeps a policy every 50,000
steps; afterwards they are looked at in turn, and the first that walks, for each command
and from rest, says by the time its file was written how long it took. So the checks
cost the training nothing.

A seed can be interrupted: what is finished is a file in `--work` and is not repeated.
"""

from __future__ import annotations

import json
import math
import shlex
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import torch
import tyro

from data.files.files import write_atomically

from .harness import Figure, gaitpref, median, publish
from .until_it_walks import look

GOALS = {
    "wall_s_median": "<= 150",
    "wall_s_worst": "",
    "walked": "all five seeds",
}


@dataclass(frozen=True, kw_only=True)
class Options:
    """Measure the time from nothing to walking."""

    work: Path = Path("runs/benchmark-walk")
    """Directory of the runs; finished ones are not repeated."""
    seeds: int = 5
    """Trainings, each from another seed."""
    steps: int = 1_500_000
    """Environment steps after which a seed has failed."""
    every: int = 50_000
    """Environment steps between two policies that are looked at."""
    episodes: int = 64
    """Episodes of 10 s each of them is judged by."""
    more: str = ""
    """Further options of `gaitpref train`, as one text: --more="--observe imu"."""
    quick: bool = False
    """A small version that shows that everything runs; its figures mean nothing."""
    json: Path | None = None
    """File for the figures."""


@dataclass(frozen=True)
class Outcome:
    """One seed."""

    wall_s: float | None
    """From the start of the command to the first policy that walks; None: none did."""
    steps: int
    """Environment steps of that policy, or all."""
    tracking_error_m_s: float
    """Tracking error of the policy that walked, or of the last one."""
    whole_s: float
    """The whole command."""


def trained(options: Options, seed: int) -> Outcome:
    """Train one seed and look at what it kept on the way."""
    out, done = options.work / f"seed-{seed}", options.work / f"seed-{seed}.json"
    if done.exists():
        return Outcome(**json.loads(done.read_text()))
    command = ["train", "--reward", "task", "--out", str(out), "--seed", str(seed)]
    command += ["--steps", str(options.steps)]
    command += ["--checkpoints", str(options.steps // options.every - 1)]
    start_s = time.time()
    run = gaitpref(*command, *shlex.split(options.more))
    outcome = _first_walk(options, out, start_s, run.wall_s)
    write_atomically(done, json.dumps(asdict(outcome)).encode())
    return outcome


def _first_walk(options: Options, out: Path, start_s: float, whole_s: float) -> Outcome:
    steps, error = 0, math.inf
    for path in (*sorted((out / "checkpoints").glob("*.pt")), out / "policy.pt"):
        looked = look(path, episodes=options.episodes)
        steps, error = looked.steps, looked.evaluation.tracking_error_m_s
        if looked.walking.walks:
            return Outcome(path.stat().st_mtime - start_s, steps, error, whole_s)
    return Outcome(None, steps, error, whole_s)


def figures_of(outcomes: list[Outcome]) -> dict[str, Figure]:
    """Median and worst over the seeds; None where it is a seed that never walked."""
    walls = [math.inf if o.wall_s is None else o.wall_s for o in outcomes]
    figures: dict[str, Figure] = {
        "wall_s_median": _finite(median(walls)),
        "wall_s_worst": _finite(max(walls)),
        "walked": sum(o.wall_s is not None for o in outcomes),
        "seeds": len(outcomes),
        "steps_median": median([float(o.steps) for o in outcomes]),
    }
    for seed, outcome in enumerate(outcomes):
        figures |= {f"{k}_{seed}": v for k, v in asdict(outcome).items()}
    return figures


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> None:
    """Train every seed and publish the figures."""
    torch.set_num_threads(1)
    if options.quick:
        options = replace(options, seeds=1, steps=12_288, every=6_144, episodes=8)
    outcomes = [trained(options, seed) for seed in range(options.seeds)]
    publish("walk", figures_of(outcomes), GOALS, options.json)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
