"""What `benchmarks.offpolicy` is told, and how its policies are measured."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from gaitpref.raters.criteria import load_criterion
from gaitpref.raters.criterion_scores import criterion_context, score_of_criterion
from policy.robots.shipped import WALK
from policy.rollouts.evaluate import evaluate
from policy.training.checkpoint import load_policy

Part = Literal["walk", "priorities", "offline", "answers"]
FAST = ("--algorithm", "fastsac")


@dataclass(frozen=True, kw_only=True)
class Options:
    """Measure off-policy learning against PPO."""

    work: Path = Path("runs/benchmark-offpolicy")
    """Directory of the runs; finished ones are not repeated."""
    parts: tuple[Part, ...] = ("walk", "priorities", "offline", "answers")
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
    """The criterion that is learned offline, beside the task, and from answers."""
    base: Path = WALK
    """The walk that the style is learned on."""
    recorded: int = 192
    """Episodes of the data set."""
    offline_steps: int = 200_000
    """How long is learned offline, as long as so many steps would be."""
    online_steps: int = 400_000
    """Environment steps of PPO on the style."""
    clone_weights: tuple[float, ...] = (0.0, 0.2, 1.0)
    """How much staying near the data counts, one offline training each."""
    labels: int = 100
    """Answers of each loop."""
    rounds: int = 2
    """Its rounds."""
    answered_steps: int = 100_000
    """Environment steps of each of its trainings."""
    more: str = ""
    """Further options of the off-policy `gaitpref train`, as one text:
    --more="--actors 2"."""
    quick: bool = False
    """A small version that shows that everything runs; its figures mean nothing."""
    json: Path | None = None
    """File for the figures."""


def more_of(options: Options) -> tuple[str, ...]:
    """Further options, word by word."""
    return tuple(shlex.split(options.more))


def episodes_of(options: Options) -> int:
    """Of what a policy is judged by."""
    return 8 if options.quick else 64


def earned(options: Options, reward: str, file: Path) -> float:
    """Mean return of the policy in `file` under `reward`."""
    policy = load_policy(file)
    context = criterion_context(policy.robot(), policy.info.env)
    score = score_of_criterion(load_criterion(reward, context))
    return evaluate(policy, score, episodes=episodes_of(options)).return_mean
