"""One training of `benchmarks.actors`, and what it cost.

    torchrun --standalone --nproc-per-node 2 -m benchmarks.actors_run --out DIR ...

is how the benchmark starts the trainings of several ranks.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import torch
import tyro
from rich.console import Console

from policy.engines.actors_cfg import ActorsCfg
from policy.engines.with_actors import WithActors
from policy.env.env_cfg import EnvCfg
from policy.env.velocity_commands import env_for
from policy.parallel.ranks import ALONE, Ranks, joined
from policy.robots.robot import load_robot
from policy.training.ppo import IterationStats, PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg

Way = Literal["ppo", "torchrun", "sync", "vtrace", "gradients", "physics"]
LOG = "iterations.jsonl"
TORCHRUN = (sys.executable, "-m", "torch.distributed.run", "--standalone")
console = Console(stderr=True)


@dataclass(frozen=True, kw_only=True)
class Training:
    """One training, by what decides it."""

    out: Path
    """Its directory."""
    way: Way
    count: int
    """Actors, or ranks."""
    seed: int
    steps: int
    checkpoints: int


def run(training: Training) -> list[dict[str, float]]:
    """Train, or go on with it; gives what every iteration took and told.

    Raises:
        KeyboardInterrupt: somebody stopped it.
        RuntimeError: a rank failed.
    """
    if training.way == "torchrun":
        _on_ranks(training)
    else:
        _here(training, ALONE)
    # One that was repeated counts the last time.
    lines = map(json.loads, (training.out / LOG).read_text().splitlines())
    return list({line["steps"]: line for line in lines}.values())


def mean_of(iterations: Sequence[dict[str, float]], name: str) -> float | None:
    """Mean over all iterations; None where nobody counts it."""
    if not any(name in each for each in iterations):
        return None
    return sum(each.get(name, 0.0) for each in iterations) / len(iterations)


def _cfg(training: Training) -> TrainCfg:
    env, ppo = EnvCfg(), PpoCfg()
    if training.way == "physics":
        # Five times the physics of a control step of 20 ms, and a fifth of the epochs.
        env = replace(env, physics_dt_s=0.001, substeps=20)
        ppo = replace(ppo, epochs=1)
    robot = load_robot(physics_dt_s=env.physics_dt_s)
    return TrainCfg(
        steps=training.steps,
        env=env_for(robot, env),
        ppo=ppo,
        seed=training.seed,
        checkpoints=training.checkpoints,
    )


def _here(training: Training, ranks: Ranks) -> None:
    cfg = _cfg(training)
    training.out.mkdir(parents=True, exist_ok=True)

    def note(stats: IterationStats) -> None:
        if not ranks.is_first:
            return
        figures = {k: v for k, v in stats.scalars.items() if k.startswith("actors/")}
        took_s = cfg.ppo.steps_per_iteration / stats.steps_per_s
        with (training.out / LOG).open("a") as file:
            line = {"steps": stats.steps, "took_s": took_s, **figures}
            file.write(json.dumps(line) + "\n")

    engine = None
    if training.way not in ("ppo", "torchrun"):
        # `cores` is what Ray is told, not what there is.
        cores = max(training.count, os.cpu_count() or 1)
        update = "vtrace" if training.way == "physics" else training.way
        told = ActorsCfg(actors=training.count, update=update, cores=cores)
        engine = WithActors(cfg=told, tell=console.print)
    robot = load_robot(physics_dt_s=cfg.env.physics_dt_s)
    result = train(
        *(training.out, robot, cfg),
        resume=True,
        on_iteration=note,
        ranks=ranks,
        engine=engine,
    )
    if not result.finished:
        raise KeyboardInterrupt


def _on_ranks(training: Training) -> None:
    command = [*TORCHRUN, "--nproc-per-node", str(training.count)]
    command += ["-m", "benchmarks.actors_run", "--out", str(training.out)]
    command += ["--way", training.way, "--count", str(training.count)]
    command += ["--seed", str(training.seed), "--steps", str(training.steps)]
    command += ["--checkpoints", str(training.checkpoints)]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    if subprocess.run(command, env=environment, check=False).returncode:
        raise RuntimeError(f"{' '.join(command)} failed")


def main(training: Annotated[Training, tyro.conf.FlagCreatePairsOff]) -> None:
    """Be one of the ranks of `training`."""
    torch.set_num_threads(1)
    with joined() as ranks:
        _here(training, ranks)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
