"""What learning off-policy saves in environment steps, and what it costs in time.

    python -m benchmarks.offpolicy [--parts walk priorities offline answers] [--quick]

*walk*: from nothing to a robot that walks, by the rule and the command of
`benchmarks.walk`, with PPO and off-policy, the same seeds. *priorities*: off-policy
once more, as long and with the same seeds, learning more often from steps the critics
err about. *offline*: a style out of a
data set of the walk that ships in many postures, without one new step; its share of
what PPO gains on the style in `online_steps` of its own, and how far its actions are
from those in the data, with each weight of cloning. *answers*: the same style out of
answers of a simulated rater who never errs, by a loop that learns off-policy and one
with PPO, of as many environment steps: its share of PPO's gain.

It can be interrupted: what is finished is a file in `--work` and is not repeated.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated

import torch
import tyro

from . import walk
from .harness import Figure, median, publish
from .offpolicy_plan import FAST, Options, earned, episodes_of, more_of
from .offpolicy_styles import answers, offline

GOALS = {
    "steps_share_median": "<= 0.33 of PPO's",
    "steps_share_worst": "<= 0.33 of PPO's",
    "walked_fastsac": "all seeds",
}


def to_walk(options: Options) -> dict[str, Figure]:
    """Steps and time from nothing to a walk, of both learners."""
    figures: dict[str, Figure] = {}
    steps: dict[str, list[float]] = {}
    for name, most, more in (
        ("ppo", options.ppo_steps, ()),
        ("fastsac", options.fast_steps, (*FAST, *more_of(options))),
    ):
        steps[name] = _walks(options, name, most, more, figures)
    shares = [
        fast / slow if math.isfinite(fast) and math.isfinite(slow) else math.inf
        for fast, slow in zip(steps["fastsac"], steps["ppo"], strict=True)
    ]
    for name, value in (("median", median(shares)), ("worst", max(shares))):
        figures[f"steps_share_{name}"] = value if math.isfinite(value) else None
    return figures


def _walks(
    options: Options,
    name: str,
    most: int,
    more: Sequence[str],
    figures: dict[str, Figure],
) -> list[float]:
    """Steps to a walk, seed by seed, infinite where it never walked; tells `figures` of
    them."""
    how = walk.Options(
        work=options.work / name,
        steps=most,
        every=options.every,
        episodes=episodes_of(options),
        more=shlex.join(more),
    )
    found = [walk.trained(how, seed) for seed in options.seeds]
    figures[f"walked_{name}"] = sum(o.wall_s is not None for o in found)
    for seed, outcome in zip(options.seeds, found, strict=True):
        figures[f"steps_{name}_{seed}"] = outcome.steps
        figures[f"wall_s_{name}_{seed}"] = outcome.wall_s
    return [math.inf if o.wall_s is None else o.steps for o in found]


def priorities(options: Options) -> dict[str, Figure]:
    """Steps to a walk, and the return in the end, drawn evenly and by priority."""
    figures: dict[str, Figure] = {}
    returns: dict[str, list[float]] = {}
    # Those drawn evenly are the walks off-policy of the other part.
    for name, more in (("fastsac", ()), ("prioritised", ("--prioritised",))):
        more = (*FAST, *more_of(options), *more)
        _walks(options, name, options.fast_steps, more, figures)
        returns[name] = [
            earned(options, "task", options.work / name / f"seed-{seed}/policy.pt")
            for seed in options.seeds
        ]
        figures[f"return_{name}_median"] = median(returns[name])
        for seed, found in zip(options.seeds, returns[name], strict=True):
            figures[f"return_{name}_{seed}"] = found
    gains = [p - e for e, p in zip(*returns.values(), strict=True)]
    return {**figures, "return_gain_by_priority_median": median(gains)}


_PARTS = {
    "walk": to_walk,
    "priorities": priorities,
    "offline": offline,
    "answers": answers,
}


def measured(options: Options) -> Mapping[str, Figure]:
    """The figures of all parts."""
    found: dict[str, Figure] = {}
    for part in options.parts:
        found |= _PARTS[part](options)
    return found


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> None:
    """Measure and publish."""
    torch.set_num_threads(1)
    if options.quick:
        options = replace(
            options,
            seeds=options.seeds[:1],
            ppo_steps=6_144,
            # Longer than it only collects.
            fast_steps=5_120,
            every=2_560,
            recorded=8,
            offline_steps=1_024,
            online_steps=3_072,
            clone_weights=options.clone_weights[:1],
            labels=12,
            rounds=1,
            answered_steps=4_608,
            more="--updates-per-step 0.01",
        )
    publish("off-policy", measured(options), GOALS, options.json)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
