"""What grows with what, as tables in `docs/benchmarks.md`.

    python -m benchmarks.scale_table [--costs FILE] [--page FILE]

Trainings are simulated anew from costs that `python -m benchmarks.scale_model --json`
kept: with the learner they were measured on, and with two that are faster, so that each
part is seen to be the limit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro

from .marks import write_between
from .scale_costs import Costs, rater_cores
from .scale_model import Options, Simulated, read_costs, saturations, simulate

MARK = "scale"
LEARNERS: tuple[tuple[str, float, int], ...] = (
    ("The learner on one core", 1.0, 1),
    ("A learner 50 times as fast, as on a GPU; one core takes in what comes", 50.0, 1),
    ("One 1,000 times as fast, for which 16 cores take it in", 1_000.0, 16),
)
"""What it is called, how fast it is, and how many cores take in rollouts."""


@dataclass(frozen=True, kw_only=True)
class Publish:
    """Simulate trainings, and put them into the page."""

    costs: Path = Path("docs/results/scale.json")
    """What `python -m benchmarks.scale_model --json` wrote."""
    page: Path = Path("docs/benchmarks.md")
    """Page with the two lines the tables stand between."""


def parts(costs: Costs, options: Options) -> str:
    """What each part costs, and when it is full."""
    filled = saturations(costs, options)
    rows = [
        ("an actor", f"{1e6 * costs.actor_s:.0f} µs a step", ""),
        (
            "the learner, one core",
            f"{1e6 * costs.learner_s:.0f} µs a step, and "
            f"{1e6 * costs.adopt_s:.1f} µs to take it in",
            _full(costs, options, 1.0, 1),
        ),
        *(
            (
                f"a learner {speed:,.0f} times as fast, {_cores(taking_in)}",
                f"{1e6 * _step_s(costs, speed, taking_in):.2g} µs a step",
                _full(costs, options, speed, taking_in),
            )
            for _, speed, taking_in in LEARNERS[1:]
        ),
        (
            f"a line of {8 * options.line_bytes_per_s / 1e9:.0f} Gbit/s",
            f"{costs.step_bytes:.0f} bytes a step",
            _steps(filled["actors_that_fill_the_line"], costs),
        ),
        (
            "`gradients`, and `torchrun`",
            f"{costs.gradient_bytes:,.0f} bytes a gradient: "
            f"{costs.gradient_bytes / 4:,.0f} parameters of four bytes",
            "",
        ),
        (
            "label host",
            f"{costs.rater_cores:.3f} cores a rater",
            f"{filled['raters_that_fill_a_core_of_the_label_host']:.0f} raters a core",
        ),
        (
            "data set",
            f"{costs.log_bytes_per_s / 1e3:.0f} kB for each second of a robot",
            f"{filled['robot_hours_logged_in_a_gigabyte']:.1f} hours a GB",
        ),
    ]
    lines = ["| part | costs | full at |", "|---|---|---|"]
    return "\n".join(lines + [f"| {' | '.join(row)} |" for row in rows])


def _step_s(costs: Costs, speed: float, taking_in: int) -> float:
    return costs.learner_s / speed + costs.adopt_s / taking_in


def _cores(taking_in: int) -> str:
    return "one core to take in" if taking_in == 1 else f"{taking_in} cores to take in"


def _full(costs: Costs, options: Options, speed: float, taking_in: int) -> str:
    given = replace(options, learner_speed=speed, taking_in=taking_in)
    return _steps(saturations(costs, given)["actors_that_fill_the_learner"], costs)


def _steps(actors: float, costs: Costs) -> str:
    """That many actors, and the steps they bring, to two digits or three."""
    count = f"{actors:.1f}" if actors < 10 else f"{actors:.0f}"
    return f"{count} actors, {float(f'{actors / costs.actor_s:.2g}'):,.0f} steps/s"


def busy(rows: list[Simulated]) -> str:
    """How busy each part is, with so many actors."""
    lines = [
        "| actors | steps/s | actors busy | learner | line | lag | dropped | limit |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        lines.append(
            f"| {row.actors:,} | {row.steps_per_s:,.0f} | {_share(row.actors_busy)} | "
            f"{_share(row.learner_busy)} | {_share(row.line_busy)} | "
            f"{row.lag_mean:.1f} | {_share(row.dropped)} | {row.limit} |"
        )
    return "\n".join(lines)


def _share(value: float) -> str:
    """Percent, whole where it is one or more."""
    # What is counted may have begun a little before.
    percent = 100 * min(value, 1.0)
    return f"{percent:.0f} %" if percent >= 0.95 or not percent else f"{percent:.1g} %"


def told(costs: Costs, options: Options) -> str:
    """All that stands between the two lines."""
    texts = [parts(costs, options), "Each part is busy for so much of the time:"]
    for name, speed, taking_in in LEARNERS:
        given = replace(options, learner_speed=speed, taking_in=taking_in)
        rows = [simulate(costs, actors, given) for actors in options.actors]
        texts += [f"{name}:", busy(rows)]
    return "\n\n".join(texts)


def main(options: Annotated[Publish, tyro.conf.FlagCreatePairsOff]) -> None:
    """Read the costs, simulate, and write the page."""
    # Raters are measured elsewhere, and by then perhaps again.
    costs = replace(read_costs(options.costs), rater_cores=rater_cores())
    write_between(options.page, MARK, told(costs, Options()))


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
