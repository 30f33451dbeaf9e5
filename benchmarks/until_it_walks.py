"""Training on the task in parts, until the policy walks for each command and from rest.

It can be interrupted anywhere: training goes on where it was.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

from gaitpref.raters.criterion_scores import criterion_context
from gaitpref.training.total_reward import load_score
from policy.robots.robot import Robot
from policy.rollouts.evaluate import Evaluation, rollout_features, summarise
from policy.rollouts.walking import Walking, table, walking
from policy.training.checkpoint import load_policy
from policy.training.train import train
from policy.training.train_cfg import TrainCfg


@dataclass(frozen=True, kw_only=True)
class Parts:
    """How often it is looked at, and how long it is tried."""

    first_steps: int
    """Environment steps before the first look."""
    steps: int
    """Environment steps between two looks."""
    most_steps: int
    """Environment steps after which it has failed."""
    episodes: int = 64
    """Episodes of a look, spread over the grid of commands."""


@dataclass(frozen=True, kw_only=True)
class Looked:
    """What a policy was seen to do."""

    policy: Path
    steps: int
    evaluation: Evaluation
    """Under the task."""
    walking: Walking
    wall_s: float = 0.0
    """What training and looking took, since it was last interrupted."""


def until_it_walks(out: Path, robot: Robot, cfg: TrainCfg, parts: Parts) -> Looked:
    """Train in `out` until the policy walks, or `most_steps` are used up.

    Args:
        out: Directory of the training.
        robot: Who walks.
        cfg: All but how many steps.
        parts: When it is looked at.

    Raises:
        KeyboardInterrupt: it was interrupted; the same call goes on.
    """
    begun_s = time.perf_counter()
    steps = parts.first_steps
    while True:
        trained = train(out, robot, replace(cfg, steps=steps), resume=True)
        if not trained.finished:
            raise KeyboardInterrupt
        looked = look(trained.policy, episodes=parts.episodes)
        print(f"{out.name} after {looked.steps:,} steps")
        print(table(looked.walking), flush=True)
        if looked.walking.walks or steps >= parts.most_steps:
            return replace(looked, wall_s=time.perf_counter() - begun_s)
        steps = min(steps + parts.steps, parts.most_steps)


def look(file: Path, *, episodes: int, seed: int = 0) -> Looked:
    """The policy in `file` over the grid of commands, and from rest."""
    policy = load_policy(file)
    robot, env = policy.robot(), policy.info.env
    features, lengths = rollout_features(
        policy, robot, env, episodes=episodes, seed=seed
    )
    score = load_score("task", criterion_context(robot, env))
    return Looked(
        policy=file,
        steps=policy.info.steps,
        evaluation=summarise(features, lengths, score, control_dt_s=env.control_dt_s),
        walking=walking(policy, robot, env, features, lengths, seed=seed),
    )
