"""What grows with what, from one actor to ten thousand.

    python -m benchmarks.scale_model [--costs FILE] [--json FILE]

Costs of single steps are measured here (`scale_costs.py`); a simulation of events puts
them together as `policy/engines` does: each actor has one rollout under way, the
learner takes as many as there are actors, those that are too old are dropped, and all
share one line. `--costs FILE` takes costs that were measured before, or elsewhere.
`python -m benchmarks.scale_table` puts them into `docs/benchmarks.md`, with learners so
fast that every part is seen to be the limit.
"""

from __future__ import annotations

import heapq
import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from data.files.files import write_atomically

from .scale_costs import Costs, measured_costs

FULL = 0.95
"""Share of its time from which on a part is the limit."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Simulate a training with more actors than there are here."""

    actors: tuple[int, ...] = (1, 2, 4, 8, 16, 32, 100, 1_000, 10_000)
    """How many."""
    envs: int = 32
    """Environments of each."""
    rollout_steps: int = 24
    """Steps of a rollout."""
    updates: int = 30
    """Updates of each simulated training; the first third is not counted."""
    most_lag: int = 2
    """Updates after which a rollout is too old."""
    line_bytes_per_s: float = 1.25e9
    """The learner's network, each way; 10 Gbit/s."""
    learner_speed: float = 1.0
    """How many times as fast as the core measured here the learner is, as on a GPU."""
    taking_in: int = 1
    """Cores of the learner that take in what actors send."""
    jitter: float = 0.1
    """Deviation of the logarithm of how long a rollout takes."""
    costs: Path | None = None
    """Costs measured before; by default they are measured now."""
    seed: int = 0
    json: Path | None = None
    """File for costs and figures."""


@dataclass(frozen=True, kw_only=True)
class Simulated:
    """A training with so many actors."""

    actors: int
    steps_per_s: float
    """Environment steps that are learned from."""
    actors_busy: float
    """Share of their time in which actors simulate."""
    learner_busy: float
    line_busy: float
    lag_mean: float
    """Updates since the weights of the rollouts learned from."""
    dropped: float
    """Share of the rollouts that were too old."""

    @property
    def limit(self) -> str:
        """The part that all others wait for."""
        busy = {"learner": self.learner_busy, "line": self.line_busy}
        name = max(busy, key=lambda each: busy[each])
        return name if busy[name] >= FULL else "actors"


def simulate(costs: Costs, actors: int, options: Options) -> Simulated:
    """One training, event by event."""
    rng = np.random.default_rng(options.seed)
    steps = options.envs * options.rollout_steps
    learn_s = actors * steps * costs.learner_s / options.learner_speed
    adopt_s = steps * costs.adopt_s / options.taking_in
    there_s = costs.weights_bytes / options.line_bytes_per_s
    back_s = steps * costs.step_bytes / options.line_bytes_per_s
    now_s, version = 0.0, 0
    # Both ways of the line are free at once.
    out_free_s, in_free_s = 0.0, 0.0
    sent: list[tuple[float, int, float]] = []
    from_s, counted = 0.0, 0
    acted_s = learned_s = line_s = 0.0
    lags: list[int] = []
    dropped = 0

    def ask(count: int) -> None:
        """Let `count` idle actors begin, with the newest weights."""
        nonlocal out_free_s
        took = costs.actor_s * steps * rng.lognormal(sigma=options.jitter, size=count)
        for collect_s in took.tolist():
            out_free_s = max(out_free_s, now_s) + there_s
            heapq.heappush(sent, (out_free_s + collect_s, version, collect_s))

    ask(actors)
    for update in range(options.updates):
        if update == options.updates // 3:
            from_s, acted_s, learned_s, line_s = now_s, 0.0, 0.0, 0.0
            lags, dropped, counted = [], 0, 0
        taken = 0
        while taken < actors:
            done_s, of, collect_s = heapq.heappop(sent)
            in_free_s = max(in_free_s, done_s) + back_s
            line_s += max(back_s, there_s)
            now_s = max(now_s, in_free_s) + adopt_s
            acted_s += collect_s
            learned_s += adopt_s
            if version - of > options.most_lag:
                dropped += 1
            else:
                taken += 1
                lags.append(version - of)
            ask(1)
        now_s += learn_s
        learned_s += learn_s
        version += 1
        counted += 1
    whole_s = now_s - from_s
    return Simulated(
        actors=actors,
        steps_per_s=counted * actors * steps / whole_s,
        actors_busy=acted_s / (whole_s * actors),
        learner_busy=learned_s / whole_s,
        line_busy=line_s / whole_s,
        lag_mean=float(np.mean(lags)),
        dropped=dropped / (dropped + len(lags)),
    )


def table(rows: list[Simulated]) -> Table:
    """`rows` for people."""
    shown = Table(
        "actors", "steps/s", "actors busy", "learner", "line", "lag", "dropped", "limit"
    )
    for row in rows:
        shown.add_row(
            f"{row.actors:,}",
            f"{row.steps_per_s:,.0f}",
            f"{row.actors_busy:.0%}",
            f"{row.learner_busy:.0%}",
            f"{row.line_busy:.0%}",
            f"{row.lag_mean:.1f}",
            f"{row.dropped:.0%}",
            row.limit,
        )
    return shown


def saturations(costs: Costs, options: Options) -> dict[str, float]:
    """How many of whom fill each part, by its costs alone."""
    per_actor = 1.0 / costs.actor_s
    adopt_s = costs.adopt_s / options.taking_in
    learner_s = costs.learner_s / options.learner_speed + adopt_s
    weights = costs.weights_bytes / (options.envs * options.rollout_steps)
    line = max(costs.step_bytes, weights) / options.line_bytes_per_s
    return {
        "actors_that_fill_the_learner": 1.0 / (learner_s * per_actor),
        "actors_that_fill_the_line": 1.0 / (line * per_actor),
        "raters_that_fill_a_core_of_the_label_host": 1.0 / costs.rater_cores,
        "robot_hours_logged_in_a_gigabyte": 1e9 / (costs.log_bytes_per_s * 3600.0),
    }


def read_costs(file: Path) -> Costs:
    """Costs that `--json` kept."""
    told = json.loads(file.read_text())["costs"]
    return Costs(**{field.name: told[field.name] for field in fields(Costs)})


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> None:
    """Measure, simulate, and print."""
    console = Console()
    costs = measured_costs() if options.costs is None else read_costs(options.costs)
    rows = [simulate(costs, actors, options) for actors in options.actors]
    filled = saturations(costs, options)
    console.print(table(rows))
    for name, value in (asdict(costs) | filled).items():
        console.print(f"{name.replace('_', ' ')}: {value:.4g}")
    if options.json is not None:
        told = {
            "costs": asdict(costs),
            "filled": filled,
            "rows": list(map(asdict, rows)),
        }
        write_atomically(options.json, json.dumps(told, indent=1).encode())


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
