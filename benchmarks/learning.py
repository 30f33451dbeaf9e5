"""Does it learn: PPO on the task, walking from answers alone, the fit, memory.

`python -m benchmarks.learning` takes an hour and a half on two cores and can be
interrupted: every command in it goes on where it was (`--work`).
"""

from __future__ import annotations

import json
import resource
import shutil
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import torch
import tyro

from gaitpref.cli.options.options import Loop
from gaitpref.cli.shared.loop_arguments import resolve
from gaitpref.loop.run import run_loop
from gaitpref.raters.criterion_scores import score_of_criterion
from policy.env.task_reward import task_reward_for, task_score
from policy.rollouts.evaluate import Evaluation, evaluate_actor
from policy.rollouts.rollout import Actor, hold_home
from policy.training.checkpoint import Policy, load_policy

from .harness import Figure, Run, gaitpref, median, publish

GOALS = {
    "train_tracking_error_m_s": "at most 0.20",
    "train_falls": "0 in 64 episodes",
    "scratch_reached": "at least 3 of 5 seeds",
    "scratch_wall_s_max": "at most 900",
    "scratch_peak_mb": "under 3072",
    "fit_300_pairs_s": "at most 10",
}
REACHED = 0.6
"""Fraction of the true-reward policy's gain over standing that counts as walking."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Measure training on the task, walking from answers alone, the fit, memory."""

    work: Path = Path("runs/benchmark-learning")
    """Directory of the runs; finished ones are not repeated."""
    seeds: int = 5
    """Seeds of the walk from answers alone."""
    quick: bool = False
    """A small version that shows that everything runs; its figures mean nothing."""
    json: Path | None = None
    """File for the figures."""


def measure(actor: Actor, policy: Policy) -> Evaluation:
    """`actor` on the robot and grid of `policy`, under the task."""
    robot = policy.robot()
    cfg = task_reward_for(robot, policy.info.env.task)
    dt_s = policy.info.env.control_dt_s

    def score(features: torch.Tensor) -> torch.Tensor:
        return task_score(features, cfg, control_dt_s=dt_s)

    return evaluate_actor(actor, robot, policy.info.env, score_of_criterion(score))


def train_figures(options: Options) -> dict[str, Figure]:
    """PPO on the task for the 1.5 M steps of the goal."""
    out = options.work / "task"
    steps = 6144 if options.quick else 1_500_000
    if not (out / "seconds.txt").exists():
        run = gaitpref("train", "--out", out, "--reward", "task", "--steps", str(steps))
        (out / "seconds.txt").write_text(str(run.wall_s))
    wall_s = float((out / "seconds.txt").read_text())
    result = measure_file(out / "policy.pt")
    return {
        "train_steps": steps,
        "train_wall_s": wall_s,
        "train_steps_per_s": steps / wall_s,
        "train_return": result.return_mean,
        "train_tracking_error_m_s": result.tracking_error_m_s,
        "train_falls": result.falls,
    }


def measure_file(path: Path) -> Evaluation:
    """The policy in a file, under the task."""
    policy = load_policy(path)
    return measure(policy, policy)


def scratch_figures(options: Options) -> dict[str, Figure]:
    """Walking from answers alone, against PPO on the true reward at equal steps."""
    figures: dict[str, Figure] = {}
    walls: list[float] = []
    fractions: list[float] = []
    peaks: list[float] = []
    true_return = stand = 0.0
    for seed in range(1 if options.quick else options.seeds):
        run = options.work / f"scratch-{seed}"
        figures |= _scratch_run(options, run, seed)
        walls.append(float(figures[f"scratch_wall_s_{seed}"] or 0))
        peaks.append(float(figures[f"scratch_peak_mb_{seed}"] or 0))
        policy = load_policy(max(run.glob("rounds/*/policy/policy.pt")))
        if not fractions:
            true_return = _true_return(options, policy.info.steps)
            stand = measure(hold_home, policy).return_mean
            figures |= {"true_return": true_return, "stand_return": stand}
        result = measure(policy, policy)
        fraction = (result.return_mean - stand) / (true_return - stand)
        fractions.append(fraction)
        figures |= {
            f"scratch_fraction_{seed}": fraction,
            f"scratch_tracking_error_m_s_{seed}": result.tracking_error_m_s,
            f"scratch_falls_{seed}": result.falls,
        }
    return figures | {
        "scratch_fraction_median": median(fractions),
        "scratch_reached": sum(f >= REACHED for f in fractions),
        "scratch_wall_s_max": max(walls),
        "scratch_peak_mb": max(peaks),
    }


def _scratch_run(options: Options, run: Path, seed: int) -> dict[str, Figure]:
    done = options.work / f"scratch-{seed}.json"
    if not done.exists():
        # A run that was interrupted would be timed wrongly.
        shutil.rmtree(run, ignore_errors=True)
        result = _small_loop(run) if options.quick else _scratch_loop(run, seed)
        figures = {
            f"scratch_wall_s_{seed}": result.wall_s,
            f"scratch_peak_mb_{seed}": result.peak_mb,
        }
        done.write_text(json.dumps(figures))
    return json.loads(done.read_text())


def _scratch_loop(run: Path, seed: int) -> Run:
    """The loop of the goal, by its command."""
    loop = ("loop", "--run", run, "--base", "none", "--criterion", "task")
    size = ("--labels", "100", "--preset", "quick", "--seed", str(seed))
    return gaitpref(*loop, *size)


def _small_loop(run: Path) -> Run:
    """A loop of one round and few steps; the command line has none as small."""
    cfg = resolve(Loop(run=run, base="none", criterion="task", rounds=1, labels=12))
    start_s = time.perf_counter()
    ppo = replace(cfg.ppo, num_envs=32, hidden_sizes=(16,))
    small = replace(
        cfg, steps=replace(cfg.steps, last=1536), evaluation_episodes=8, ppo=ppo
    )
    run_loop(run, small)
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return Run(time.perf_counter() - start_s, peak_mb, "")


def _true_return(options: Options, steps: int) -> float:
    """Return of PPO on the task itself after as many steps."""
    out, done = options.work / "true", options.work / "true.json"
    if not done.exists():
        if not out.exists():
            # It goes on from the task's run, which had the same seed and settings.
            shutil.copytree(options.work / "task", out)
        train = ("train", "--out", out, "--reward", "task", "--resume")
        gaitpref(*train, "--steps", str(steps))
        result = measure_file(out / "policy.pt")
        done.write_text(json.dumps({"true_return": result.return_mean}))
    return json.loads(done.read_text())["true_return"]


def fit_figures(options: Options) -> dict[str, Figure]:
    """The fit on 300 answered pairs of recorded clips."""
    dataset, reward = options.work / "fit-dataset", options.work / "fit-reward"
    count = "24" if options.quick else "300"
    policy = options.work / "task" / "policy.pt"
    shutil.rmtree(dataset, ignore_errors=True)
    record = ("record", "--policy", policy, "--dataset", dataset)
    gaitpref(*record, "--episodes", "64" if options.quick else "256")
    gaitpref("pairs", "--dataset", dataset, "--count", count)
    gaitpref("answer", "--dataset", dataset, "--criterion", "high_step")
    run = gaitpref("fit", "--dataset", dataset, "--out", reward)
    return {"fit_300_pairs_s": run.wall_s, "fit_peak_mb": run.peak_mb}


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> None:
    """Measure everything and publish it."""
    torch.set_num_threads(1)
    options.work.mkdir(parents=True, exist_ok=True)
    figures: dict[str, Figure] = {}
    for part in (train_figures, fit_figures, scratch_figures):
        figures |= part(options)
    publish("learning", figures, GOALS, options.json)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
