"""Does it pay to take one round of a loop apart: recording, fits, evaluation.

    python -m benchmarks.pieces --policy POLICY [--quick] [--json FILE]

Each is done here, and as two pieces in two processes. What is counted is time of cores,
so that a busy machine does not matter: two idle cores need at least half of what both
processes took, and once in a run the imports of what they are copied from.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import torch
import tyro

from gaitpref.executor.pieces import Piece
from gaitpref.executor.processes import Processes
from policy.training.checkpoint import load_policy
from policy.training.train import train
from policy.training.train_cfg import TrainCfg

from .harness import Figure, gaitpref, publish
from .in_order import in_order
from .stage_pieces import cores_s, evaluated, fitted, recorded

STAGES = ("recording", "fits", "evaluation")
GOALS = {
    f"{name}_two_processes_s": f"taken apart only if below {name}_here_s"
    for name in STAGES
}
TRAINED_STEPS = 60_000
"""A tenth of the training of a round."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Measure the stages of a round, whole and in two pieces."""

    policy: Path
    """A policy that walks."""
    work: Path = Path("runs/benchmark-pieces")
    """Directory of what is made on the way; emptied first."""
    quick: bool = False
    """A small version that shows that everything runs; its figures mean nothing."""
    json: Path | None = None
    """File for the figures."""


def imports_s() -> float:
    """Time of cores until a process could do any of this."""
    told = "import benchmarks.stage_pieces, time; print(time.process_time())"
    command = [sys.executable, "-c", told]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True)
    return float(done.stdout)


def stage_figures(
    name: str, function: Callable[[Path, int, int], int], path: Path, count: int
) -> dict[str, Figure]:
    """A stage of `count` episodes or fits: here, and halved in two processes."""
    halves = [
        Piece(
            name=f"{name} {n}", function=cores_s, args=(function, path, count // 2, n)
        )
        for n in range(2)
    ]
    start_s = time.perf_counter()
    in_processes_s = sum(in_order(Processes(workers=2), halves))
    wall_s = time.perf_counter() - start_s
    return {
        f"{name}_here_s": cores_s(function, path, count, 0),
        f"{name}_two_processes_s": in_processes_s / 2,
        f"{name}_two_processes_wall_s": wall_s,
    }


def dataset_of(options: Options) -> Path:
    """Recorded and answered as the first rounds of a style."""
    dataset = options.work / "dataset"
    record = ("record", "--policy", options.policy, "--dataset", dataset)
    gaitpref(*record, "--episodes", "40" if options.quick else "64")
    gaitpref("pairs", "--dataset", dataset, "--count", "12" if options.quick else "30")
    gaitpref("answer", "--dataset", dataset, "--criterion", "high_step")
    return dataset


def training_s(options: Options) -> float:
    """Time of cores that the training of a round takes."""
    policy = load_policy(options.policy)
    steps = 3_072 if options.quick else TRAINED_STEPS
    cfg = TrainCfg(steps=steps, env=policy.info.env, ppo=policy.info.ppo)
    out = options.work / "train"
    robot = policy.robot()
    return 10 * cores_s(lambda: train(out, robot, cfg, init=options.policy))


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> None:
    """Measure everything and publish it."""
    torch.set_num_threads(1)
    shutil.rmtree(options.work, ignore_errors=True)
    episodes = 8 if options.quick else 64
    # The fit to all answers, and one without each of five folds.
    fits = 2 if options.quick else 6
    figures = stage_figures("recording", recorded, options.policy, episodes)
    figures |= stage_figures("fits", fitted, dataset_of(options), fits)
    figures |= stage_figures("evaluation", evaluated, options.policy, episodes)
    whole_s = training_s(options)
    stages_s = sum(float(figures[f"{name}_here_s"] or 0.0) for name in STAGES)
    figures["imports_s"] = imports_s()
    figures["training_s"] = whole_s
    figures["stages_share"] = stages_s / (stages_s + whole_s)
    publish("pieces", figures, GOALS, options.json)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
