"""What `benchmarks.pieces` does here and elsewhere: importable without the program."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from data.datasets.dataset import Dataset
from gaitpref.method.method import STYLE
from policy.rollouts.evaluate import rollout_features
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg
from policy.training.checkpoint import load_policy
from rewardmodel.answers.answered_pairs import load_pairs
from rewardmodel.fitting.fit_reward import fit_reward


def recorded(policy: Path, episodes: int, seed: int) -> int:
    """Simulate episodes as a round does; gives how many."""
    torch.set_num_threads(1)
    return len(list(record(policy, RecordCfg(episodes=episodes), seed=seed, round=0)))


def fitted(dataset: Path, fits: int, seed: int) -> int:
    """Fit so many rewards to the answers of a data set; gives how many answers."""
    torch.set_num_threads(1)
    pairs = load_pairs([Dataset.open(dataset)])
    for number in range(fits):
        fit_reward(pairs, STYLE.reward, seed=seed + number, measured=False)
    return len(pairs)


def evaluated(path: Path, episodes: int, seed: int) -> int:
    """Roll a policy out on the grid of commands; gives the steps."""
    torch.set_num_threads(1)
    policy = load_policy(path)
    _, lengths = rollout_features(
        policy, policy.robot(), policy.info.env, episodes=episodes, seed=seed
    )
    return int(lengths.sum())


def cores_s(work: Callable[..., Any], *args: Any) -> float:
    """Time of cores that a call takes in this process."""
    start_s = time.process_time()
    work(*args)
    return time.process_time() - start_s
