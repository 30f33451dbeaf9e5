"""PPO beside actors on Ray: environment steps and time to a walk, and how old rollouts
are.

    python -m benchmarks.actors [--quick] [--json FILE] [--work DIR]

Every way to update (`sync`, `vtrace`, `gradients`) with 1, 2 and 4 actors, and PPO in
one process, on the task's own reward, from equal seeds. Policies are kept on the way
and looked at afterwards; the first that walks counts. Time is that of the iterations,
so that a Ray that starts, and a run that is interrupted, cost nothing.

Ray is told of as many cores as there are actors: more actors than the machine has cores
show the lag they bring, and no gain in time.

A run can be interrupted: what is finished is a file in `--work` and is not repeated,
and what was half done goes on.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import torch
import tyro
from rich.console import Console

from data.files.files import write_atomically
from policy.engines.actors_cfg import ActorsCfg
from policy.engines.with_actors import WithActors
from policy.env.env_cfg import EnvCfg
from policy.env.velocity_commands import env_for
from policy.robots.robot import load_robot
from policy.training.ppo import IterationStats, PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg

from .harness import Figure, median, publish
from .until_it_walks import look

Way = Literal["ppo", "sync", "vtrace", "gradients"]
GOALS = {
    "vtrace_2_over_vtrace_1_steps_per_s": ">= 1.7 where the learner is not the limit",
    "vtrace_1_over_ppo_steps_per_s": ">= 0.9",
    "vtrace_2_over_ppo_walk_steps": "<= 1.3",
}
console = Console(stderr=True)


@dataclass(frozen=True, kw_only=True)
class Options:
    """Compare ways to use many cores."""

    work: Path = Path("runs/benchmark-actors")
    """Directory of the runs; finished ones are not repeated."""
    ways: tuple[Way, ...] = ("ppo", "sync", "vtrace", "gradients")
    """Which to compare; `ppo` is one process without Ray."""
    actors: tuple[int, ...] = (1, 2, 4)
    """How many, for each way but `ppo`."""
    seeds: int = 3
    """Trainings of each, from the same seeds."""
    steps: int = 1_500_000
    """Environment steps after which a training has failed."""
    every: int = 50_000
    """Environment steps between two policies that are looked at."""
    episodes: int = 64
    """Episodes each of them is judged by."""
    quick: bool = False
    """A small version that shows that everything runs; its figures mean nothing."""
    json: Path | None = None
    """File for the figures."""


@dataclass(frozen=True)
class Outcome:
    """One training."""

    walk_steps: int | None
    """Environment steps of the first policy that walks; None: none did."""
    walk_s: float | None
    """Time of the iterations up to it."""
    steps_per_s: float
    """Environment steps over all iterations and their time."""
    lag_mean: float
    """Updates since the weights of the rollouts that were used."""
    lag_most: float
    clipped_share: float
    """Of the steps, those whose ratio V-trace clipped."""
    dropped: float
    """Share of the rollouts that were too old."""
    bytes_per_step: float
    """Sent by actors for each environment step that was used."""


def trained(options: Options, way: Way, actors: int, seed: int) -> Outcome:
    """Train once, or go on with it, and look at what was kept on the way."""
    name = f"{way}-{actors}-{seed}"
    out, done = options.work / name, options.work / f"{name}.json"
    if done.exists():
        return Outcome(**json.loads(done.read_text()))
    env = EnvCfg()
    robot = load_robot(physics_dt_s=env.physics_dt_s)
    cfg = TrainCfg(
        steps=options.steps,
        env=env_for(robot, env),
        ppo=PpoCfg(),
        seed=seed,
        checkpoints=options.steps // options.every - 1,
    )
    out.mkdir(parents=True, exist_ok=True)
    log = out / "iterations.jsonl"

    def note(stats: IterationStats) -> None:
        figures = {k: v for k, v in stats.scalars.items() if k.startswith("actors/")}
        took_s = cfg.ppo.steps_per_iteration / stats.steps_per_s
        with log.open("a") as file:
            line = {"steps": stats.steps, "took_s": took_s, **figures}
            file.write(json.dumps(line) + "\n")

    engine = None
    if way != "ppo":
        # `cores` is what Ray is told, not what there is.
        cores = max(actors, os.cpu_count() or 1)
        told = ActorsCfg(actors=actors, update=way, cores=cores)
        engine = WithActors(cfg=told, tell=console.print)
    result = train(out, robot, cfg, resume=True, on_iteration=note, engine=engine)
    if not result.finished:
        raise KeyboardInterrupt
    outcome = _outcome(options, out, list(_iterations(log)))
    write_atomically(done, json.dumps(asdict(outcome)).encode())
    return outcome


def _iterations(log: Path) -> Iterator[dict[str, float]]:
    """What was noted, each iteration once: one that was repeated counts the last
    time."""
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    yield from {line["steps"]: line for line in lines}.values()


def _outcome(
    options: Options, out: Path, iterations: Sequence[dict[str, float]]
) -> Outcome:
    whole_s = sum(each["took_s"] for each in iterations)
    used = iterations[-1].get("actors/used", 0.0)
    dropped = iterations[-1].get("actors/dropped", 0.0)

    def mean(name: str) -> float:
        return sum(each.get(name, 0.0) for each in iterations) / len(iterations)

    found = Outcome(
        walk_steps=None,
        walk_s=None,
        steps_per_s=iterations[-1]["steps"] / whole_s,
        lag_mean=mean("actors/lag_mean"),
        lag_most=max(each.get("actors/lag_most", 0.0) for each in iterations),
        clipped_share=mean("actors/clipped_share"),
        dropped=dropped / max(used + dropped, 1.0),
        bytes_per_step=1e6
        * iterations[-1].get("actors/megabytes", 0.0)
        / iterations[-1]["steps"],
    )
    for path in (*sorted((out / "checkpoints").glob("*.pt")), out / "policy.pt"):
        looked = look(path, episodes=options.episodes)
        if looked.walking.walks:
            steps = looked.steps
            time_s = sum(i["took_s"] for i in iterations if i["steps"] <= steps)
            return replace(found, walk_steps=steps, walk_s=time_s)
    return found


def figures_of(outcomes: dict[str, list[Outcome]]) -> dict[str, Figure]:
    """Medians over the seeds by name, and the ratios of the goals."""
    figures: dict[str, Figure] = {}
    for name, runs in outcomes.items():
        figures[f"{name}_walked"] = sum(r.walk_steps is not None for r in runs)
        for field in asdict(runs[0]):
            values = [getattr(run, field) for run in runs]
            numbers = [math.inf if v is None else float(v) for v in values]
            middle = median(numbers)
            figures[f"{name}_{field}"] = middle if math.isfinite(middle) else None
    for one, other, field in (
        ("vtrace_2", "vtrace_1", "steps_per_s"),
        ("vtrace_1", "ppo", "steps_per_s"),
        ("vtrace_2", "ppo", "walk_steps"),
    ):
        above, below = figures.get(f"{one}_{field}"), figures.get(f"{other}_{field}")
        if isinstance(above, float) and isinstance(below, float):
            figures[f"{one}_over_{other}_{field}"] = above / below
    return figures


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> None:
    """Train all and publish the figures."""
    torch.set_num_threads(1)
    if options.quick:
        options = replace(
            options,
            ways=("ppo", "vtrace"),
            actors=(1,),
            seeds=1,
            steps=12_288,
            every=6_144,
            episodes=8,
        )
    outcomes: dict[str, list[Outcome]] = {}
    # Seeds outermost: an interrupted study has all ways from as many seeds.
    for seed in range(options.seeds):
        for way in options.ways:
            for actors in (1,) if way == "ppo" else options.actors:
                name = way if way == "ppo" else f"{way}_{actors}"
                console.print(f"seed {seed}: {name}")
                outcome = trained(options, way, actors, seed)
                outcomes.setdefault(name, []).append(outcome)
    publish("actors", figures_of(outcomes), GOALS, options.json)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
