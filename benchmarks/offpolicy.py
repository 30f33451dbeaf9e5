"""What learning off-policy saves in environment steps, and what it costs in time.

    python -m benchmarks.offpolicy [--parts walk priorities offline] [--quick]

*walk*: from nothing to a robot that walks, by the rule and the command of
`benchmarks.walk`, with PPO and off-policy, the same seeds. *priorities*: off-policy
once more, as long and with the same seeds, learning more often from steps the critics
err about. *offline*: a style out of a
data set of the walk that ships in many postures, without one new step; its share of
what PPO gains on the style in `online_steps` of its own, and how far its actions are
from those in the data.

It can be interrupted: what is finished is a file in `--work` and is not repeated.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import torch
import tyro

from data.files.files import write_atomically
from policy.robots.shipped import WALK

from . import walk
from .harness import Figure, gaitpref, median, publish

Part = Literal["walk", "priorities", "offline"]
FAST = ("--algorithm", "fastsac")
GOALS = {
    "steps_share_median": "<= 0.33 of PPO's",
    "steps_share_worst": "<= 0.33 of PPO's",
    "walked_fastsac": "all seeds",
    "offline_share_median": "",
}


@dataclass(frozen=True, kw_only=True)
class Options:
    """Measure off-policy learning against PPO."""

    work: Path = Path("runs/benchmark-offpolicy")
    """Directory of the runs; finished ones are not repeated."""
    parts: tuple[Part, ...] = ("walk", "priorities", "offline")
    """What is measured."""
    seeds: tuple[int, ...] = (0, 1, 2)
    """Where chance comes from, one training each."""
    ppo_steps: int = 1_500_000
    """Environment steps after which PPO has failed to walk."""
    fast_steps: int = 300_000
    """The same of the off-policy learner."""
    every: int = 25_000
    """Environment steps between two policies that are looked at."""
    style: str = "high_step"
    """The criterion that is learned offline, beside the task."""
    recorded: int = 192
    """Episodes of the data set."""
    offline_steps: int = 200_000
    """How long is learned offline, as long as so many steps would be."""
    online_steps: int = 400_000
    """Environment steps of PPO on the style."""
    more: tuple[str, ...] = ()
    """Further options of the off-policy `gaitpref train`."""
    quick: bool = False
    """A small version that shows that everything runs; its figures mean nothing."""
    json: Path | None = None
    """File for the figures."""


def to_walk(options: Options) -> dict[str, Figure]:
    """Steps and time from nothing to a walk, of both learners."""
    figures: dict[str, Figure] = {}
    steps: dict[str, list[float]] = {}
    for name, most, more in (
        ("ppo", options.ppo_steps, ()),
        ("fastsac", options.fast_steps, (*FAST, *options.more)),
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
        episodes=_episodes(options),
        more=tuple(more),
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
        more = (*FAST, *options.more, *more)
        _walks(options, name, options.fast_steps, more, figures)
        returns[name] = [
            _earned(options, "task", options.work / name / f"seed-{seed}/policy.pt")
            for seed in options.seeds
        ]
        figures[f"return_{name}_median"] = median(returns[name])
        for seed, earned in zip(options.seeds, returns[name], strict=True):
            figures[f"return_{name}_{seed}"] = earned
    gains = [p - e for e, p in zip(*returns.values(), strict=True)]
    return {**figures, "return_gain_by_priority_median": median(gains)}


def _episodes(options: Options) -> int:
    return 8 if options.quick else 64


def _earned(options: Options, reward: str, policy: Path) -> float:
    """Mean return of `policy` under `reward`."""
    told = gaitpref(
        *("evaluate", "--policy", policy, "--reward", reward),
        *("--episodes", str(_episodes(options)), "--json"),
    )
    return json.loads(told.stdout)["return_mean"]


def offline(options: Options) -> dict[str, Figure]:
    """The share of a style that comes out of a data set alone, seed by seed."""

    def earned(policy: Path) -> float:
        return _earned(options, options.style, policy)

    base = earned(WALK)
    figures: dict[str, Figure] = {"offline_base_return": base}
    shares = []
    for seed in options.seeds:
        row = _offline_row(options, seed)
        gains = {
            name: earned(row / name / "policy.pt") - base
            for name in ("offline", "online")
        }
        share = gains["offline"] / gains["online"] if gains["online"] > 0 else 0.0
        shares.append(share)
        figures[f"offline_share_{seed}"] = share
        figures |= {f"{name}_gain_{seed}": gain for name, gain in gains.items()}
        summary = json.loads((row / "offline" / "summary.json").read_text())
        figures[f"distance_{seed}"] = summary["offline/action_distance"]
    return {**figures, "offline_share_median": median(shares)}


def _offline_row(options: Options, seed: int) -> Path:
    """The directory of a seed's data set and both its trainings, finished."""
    row = options.work / f"offline-{options.style}-{seed}"
    if not (row / "done").exists():
        gaitpref(
            *("record", "--policy", WALK, "--dataset", row / "set"),
            *("--episodes", str(options.recorded), "--varied", "0.5"),
            *("--seed", str(seed)),
        )
        reward = ("--reward", options.style, "--keep-task", "--init", WALK)
        chance = ("--seed", str(seed), "--resume")
        gaitpref(
            *("train", "--out", row / "offline", *reward, *chance, *FAST),
            *("--offline", "--steps", str(options.offline_steps), *options.more),
            *("--replay", row / "set"),
        )
        gaitpref(
            *("train", "--out", row / "online", *reward, *chance),
            *("--steps", str(options.online_steps)),
        )
        write_atomically(row / "done", b"")
    return row


_PARTS = {"walk": to_walk, "priorities": priorities, "offline": offline}


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
            more=("--updates-per-step", "0.01"),
        )
    publish("off-policy", measured(options), GOALS, options.json)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
