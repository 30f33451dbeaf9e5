"""Whether a reward orders policies as the hidden criterion does.

Accuracy on clips of a run says little of what the reward would train: policies that
earlier rewards led astray, in other runs, are what it must not be led to either.

Shapes: T steps, N episodes, F feature columns, P policies.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from gaitpref.criteria import load_criterion
from gaitpref.rewards import criterion_context, score_of_criterion
from gaitpref.run_config import read_config
from policy.checkpoint import load_policy
from policy.evaluate import rollout_features
from policy.ppo import ScoreFn

from .harness import spearman

_EPISODES = 8


@dataclass(frozen=True, eq=False)
class Walk:
    """What one policy does on the grid of commands."""

    rows: Tensor
    """[T, N, F]"""
    alive: Tensor
    """[T, N] bool"""
    score: float
    """Mean of a step, under the hidden criterion."""

    def paid(self, reward: ScoreFn) -> float:
        """Mean of `reward` over the steps."""
        return _mean_over(self.rows, self.alive, reward)


def _mean_over(rows: Tensor, alive: Tensor, reward: ScoreFn) -> float:
    starts = torch.zeros_like(alive)
    starts[0] = True
    return float(reward(rows, starts)[alive].mean())


def walks_of(runs: Sequence[Path]) -> list[Walk]:
    """Of every policy that runs of one criterion made, also of those not approved.

    Raises:
        ValueError: the runs have several criteria, so no score orders their policies.
    """
    names = {read_config(run).criterion for run in runs}
    if len(names) != 1:
        raise ValueError(f"give runs of one criterion, not of {', '.join(names)}")
    return [_walk(path, *names) for path in _policies(runs)]


def _policies(runs: Sequence[Path]) -> Iterator[Path]:
    seen: set[bytes] = set()
    for run in runs:
        for path in sorted(run.glob("rounds/*/*/policy.pt")):
            content = path.read_bytes()
            if content not in seen:
                yield path
            seen.add(content)


def _walk(path: Path, criterion: str) -> Walk:
    policy = load_policy(path)
    robot, env = policy.robot(), policy.info.env
    rows, lengths = rollout_features(policy, robot, env, episodes=_EPISODES, seed=0)
    alive = torch.arange(len(rows))[:, None] < lengths
    score = score_of_criterion(load_criterion(criterion, criterion_context(robot, env)))
    return Walk(rows, alive, _mean_over(rows, alive, score))


def rank_correlation(walks: Sequence[Walk], reward: ScoreFn) -> float:
    """Spearman's rank correlation of what `reward` pays the policies and their scores;
    NaN for fewer than two."""
    if len(walks) < 2:
        return float("nan")
    return spearman(
        [walk.paid(reward) for walk in walks], [walk.score for walk in walks]
    )
