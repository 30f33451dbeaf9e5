"""Fitting a reward to answers, and what it makes of an episode.

Shapes: T steps of an episode, F feature columns (`data.features.FEATURES`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from data.datasets.dataset import Dataset
from data.features import FEATURE_DIM
from gaitpref.method.method import STYLE, Method
from rewardmodel.answers.answered_pairs import load_pairs
from rewardmodel.cfg import FitCfg
from rewardmodel.fitting.fit_reward import fit_reward
from rewardmodel.models.fit_report import FitReport
from rewardmodel.models.model import RewardModel


def fit(
    datasets: Sequence[Dataset], *, cfg: FitCfg | Method = STYLE, seed: int = 0
) -> tuple[RewardModel, FitReport]:
    """Fit a reward to all answers of some data sets, and measure it on held-out ones.

    Args:
        datasets: Any number; an answer that lies in several counts once.
        cfg: What is fitted, or the method whose first reward it is.
        seed: Bootstrap draws and folds.

    Raises:
        GaitprefError: too few answers prefer a clip, or a data set cannot be used.
    """
    settings = cfg.reward if isinstance(cfg, Method) else cfg
    return fit_reward(load_pairs(datasets), settings, seed=seed)


def score_episode(reward: RewardModel, rows: np.ndarray) -> np.ndarray:
    """Reward [T] of every step of an episode, of unit deviation per second over the
    clips that were judged.

    Args:
        reward: A fitted reward.
        rows: Feature rows [T, F] of the whole episode, from its first step, as
            `Dataset.features` gives them.

    Raises:
        ValueError: `rows` is no table of feature rows.
    """
    if rows.ndim != 2 or rows.shape[1] != FEATURE_DIM:
        raise ValueError(f"rows must be [T, {FEATURE_DIM}], got {list(rows.shape)}")
    with torch.inference_mode():
        paid, _ = reward.episode_rewards(torch.tensor(rows, dtype=torch.float32))
    return paid.numpy()
