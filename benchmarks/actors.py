"""PPO beside ranks of torchrun and actors on Ray: environment steps and time to a walk,
and how old rollouts are.

    python -m benchmarks.actors [--quick] [--json FILE] [--work DIR]

Every way to update (`sync`, `vtrace`, `gradients`) with 1, 2 and 4 actors, two ranks
(`torchrun`), and PPO in one process, on the task's own reward, from equal seeds.
Policies are kept on the way and looked at afterwards; the first that walks counts. Time
is that of the iterations, so that a Ray that starts, and a run that is interrupted,
cost nothing.

With PPO's settings a learner on one core is full at 1.4 actors, so that a second one
can bring no more than that. What actors bring where the learner is not the limit,
`physics` shows: V-trace with 20 physics steps of 1 ms a control step instead of 4 of 5
ms, and one epoch instead of five. By the costs of `benchmarks.scale_model`, a step then
costs an actor about four times as much and the learner a quarter, which some twenty
actors would fill. That is slow simulation, what actors are for; a smaller net would
have made actors cheaper too. It is a tenth as long, and nobody asks whether it walks.

Ray is told of as many cores as there are actors: more actors than the machine has cores
show the lag they bring, and no gain in time.

A run can be interrupted: what is finished is a file in `--work` and is not repeated,
and what was half done goes on. `python -m benchmarks.actors_table` puts what
`--json docs/results/actors.json` kept into `docs/benchmarks.md`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, get_args

import torch
import tyro
from rich.console import Console

from data.files.files import write_atomically

from .actors_run import Training, Way, mean_of, run
from .harness import Figure, median, publish
from .until_it_walks import look

GOALS = {
    "physics_2_over_physics_1_steps_per_s": ">= 1.7",
    "vtrace_1_over_ppo_steps_per_s": ">= 0.9",
    "vtrace_2_over_ppo_walk_steps": "<= 1.3",
}
console = Console(stderr=True)


@dataclass(frozen=True, kw_only=True)
class Options:
    """Compare ways to use many cores."""

    work: Path = Path("runs/benchmark-actors")
    """Directory of the runs; finished ones are not repeated."""
    ways: tuple[Way, ...] = get_args(Way)
    """Which to compare; `ppo` is one process, `torchrun` two, both without Ray."""
    actors: tuple[int, ...] = (1, 2, 4)
    """How many, for each way on Ray; `physics` has none beyond 2."""
    seeds: int = 3
    """Trainings of each, from the same seeds."""
    steps: int = 1_500_000
    """Environment steps after which a training has failed."""
    every: int = 50_000
    """Environment steps between two policies that are looked at."""
    episodes: int = 64
    """Episodes each of them is judged by."""
    only_finished: bool = False
    """Train nothing; take the seeds that are there."""
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
    clipped_share: float | None
    """Of the steps, those whose ratio V-trace clipped; None: nothing is corrected."""
    dropped: float
    """Share of the rollouts that were too old."""
    bytes_per_step: float
    """Sent by actors for each environment step that was used."""


def _file(options: Options, way: Way, count: int, seed: int) -> Path:
    """What is kept of a training that is finished."""
    return options.work / f"{way}-{count}-{seed}.json"


def trained(options: Options, way: Way, count: int, seed: int) -> Outcome:
    """Train once, or go on with it, and look at what was kept on the way."""
    out, done = options.work / f"{way}-{count}-{seed}", _file(options, way, count, seed)
    if done.exists():
        return Outcome(**json.loads(done.read_text()))
    is_speed = way == "physics"
    training = Training(
        out=out,
        way=way,
        count=count,
        seed=seed,
        steps=options.steps // 10 if is_speed else options.steps,
        checkpoints=0 if is_speed else options.steps // options.every - 1,
    )
    iterations = run(training)
    outcome = outcome_of(iterations)
    if not is_speed:
        outcome = _walked(options, out, iterations, outcome)
    write_atomically(done, json.dumps(asdict(outcome)).encode())
    return outcome


def outcome_of(iterations: Sequence[dict[str, float]]) -> Outcome:
    """What a training cost, by its iterations; whether it walks is not asked."""
    whole_s = sum(each["took_s"] for each in iterations)
    last = iterations[-1]
    used, dropped = last.get("actors/used", 0.0), last.get("actors/dropped", 0.0)
    return Outcome(
        walk_steps=None,
        walk_s=None,
        steps_per_s=last["steps"] / whole_s,
        lag_mean=mean_of(iterations, "actors/lag_mean") or 0.0,
        lag_most=max(each.get("actors/lag_most", 0.0) for each in iterations),
        clipped_share=mean_of(iterations, "actors/clipped_share"),
        dropped=dropped / max(used + dropped, 1.0),
        bytes_per_step=1e6 * last.get("actors/megabytes", 0.0) / last["steps"],
    )


def _walked(
    options: Options,
    out: Path,
    iterations: Sequence[dict[str, float]],
    outcome: Outcome,
) -> Outcome:
    """`outcome`, with the first policy that walks."""
    for path in (*sorted((out / "checkpoints").glob("*.pt")), out / "policy.pt"):
        looked = look(path, episodes=options.episodes)
        if looked.walking.walks:
            steps = looked.steps
            time_s = sum(i["took_s"] for i in iterations if i["steps"] <= steps)
            return replace(outcome, walk_steps=steps, walk_s=time_s)
    return outcome


def figures_of(outcomes: dict[str, list[Outcome]]) -> dict[str, Figure]:
    """Medians over the seeds by name, and the ratios of the goals."""
    figures: dict[str, Figure] = {}
    for name, runs in outcomes.items():
        figures[f"{name}_seeds"] = len(runs)
        unasked = {"walk_steps", "walk_s"} if name.startswith("physics") else set[str]()
        if all(run.clipped_share is None for run in runs):
            unasked.add("clipped_share")
        if "walk_steps" not in unasked:
            figures[f"{name}_walked"] = sum(r.walk_steps is not None for r in runs)
        for field in (each for each in asdict(runs[0]) if each not in unasked):
            values = [getattr(run, field) for run in runs]
            numbers = [math.inf if v is None else float(v) for v in values]
            middle = median(numbers)
            figures[f"{name}_{field}"] = middle if math.isfinite(middle) else None
    for one, other, field in (
        ("vtrace_2", "vtrace_1", "steps_per_s"),
        ("physics_2", "physics_1", "steps_per_s"),
        ("gradients_2", "gradients_1", "steps_per_s"),
        ("torchrun_2", "ppo", "steps_per_s"),
        ("vtrace_1", "ppo", "steps_per_s"),
        ("vtrace_2", "ppo", "walk_steps"),
    ):
        above, below = figures.get(f"{one}_{field}"), figures.get(f"{other}_{field}")
        if isinstance(above, float) and isinstance(below, float):
            figures[f"{one}_over_{other}_{field}"] = above / below
    return figures


def _counts(options: Options, way: Way) -> tuple[int, ...]:
    """How many processes of a way to compare."""
    match way:
        case "ppo":
            return (1,)
        case "torchrun":
            return (2,)
        case "physics":
            return tuple(count for count in options.actors if count <= 2)
        case _:
            return options.actors


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> None:
    """Train all and publish the figures."""
    torch.set_num_threads(1)
    if options.quick:
        options = replace(
            options,
            ways=("ppo", "vtrace"),
            actors=(1,),
            seeds=1,
            steps=6_144,
            every=6_144,
            episodes=8,
        )
    outcomes: dict[str, list[Outcome]] = {}
    # Seeds outermost: an interrupted study has all ways from as many seeds.
    for seed in range(options.seeds):
        for way in options.ways:
            for count in _counts(options, way):
                name = way if way == "ppo" else f"{way}_{count}"
                finished = _file(options, way, count, seed).exists()
                if options.only_finished and not finished:
                    continue
                console.print(f"seed {seed}: {name}")
                outcome = trained(options, way, count, seed)
                outcomes.setdefault(name, []).append(outcome)
    publish("actors", figures_of(outcomes), GOALS, options.json)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
