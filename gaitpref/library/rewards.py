"""Fitting a reward to answers, and what it makes of an episode.

Shapes: T steps of an episode, F feature columns (`data.features.FEATURES`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from data.datasets.dataset import Dataset
from data.features import FEATURE_DIM
from gaitpref.method.method import STYLE, Method
from rewardmodel.answers.answered_pairs import load_pairs
from rewardmodel.cfg import FitCfg
from rewardmodel.fitting.fit_reward import fit_reward
from rewardmodel.models.fit_report import FitReport
from rewardmodel.models.model import RewardModel

if TYPE_CHECKING:  # Criteria need the simulator, fitting does not.
    from gaitpref.raters.criteria import RowCriterion


def fit(
    datasets: Sequence[Dataset],
    *,
    cfg: FitCfg | Method = STYLE,
    unchecked: bool = False,
    seed: int = 0,
) -> tuple[RewardModel, FitReport]:
    """Fit a reward to all answers of some data sets, and measure it on held-out ones.

    Args:
        datasets: Any number; an answer that lies in several counts once.
        cfg: What is fitted, or the method whose first reward it is.
        unchecked: Learn from answers of programs too that do not agree with people.
        seed: Bootstrap draws and folds.

    Raises:
        GaitprefError: too few answers prefer a clip, or a data set cannot be used.
    """
    settings = cfg.reward if isinstance(cfg, Method) else cfg
    pairs = load_pairs(datasets, unchecked=unchecked)
    return fit_reward(pairs, settings, seed=seed)


def score_episode(
    reward: RewardModel | RowCriterion | str, rows: np.ndarray
) -> np.ndarray:
    """Reward [T] of every step of an episode, per second.

    That of a fitted reward has mean 0 and unit deviation over the clips that were
    judged.

    Args:
        reward: A fitted reward, a criterion of one's own `features [..., F] -> score
            [...]`, or the name of one, as `gaitpref loop --criterion` takes it, for the
            robot that ships.
        rows: Feature rows [T, F] of the whole episode, from its first step, as
            `Dataset.features` gives them.

    Raises:
        ValueError: `rows` is no table of feature rows.
        GaitprefError: there is no such criterion.
    """
    if rows.ndim != 2 or rows.shape[1] != FEATURE_DIM:
        raise ValueError(f"rows must be [T, {FEATURE_DIM}], got {list(rows.shape)}")
    features = torch.tensor(rows, dtype=torch.float32)
    with torch.inference_mode():
        if isinstance(reward, str):
            return _by_name(reward, features).numpy()
        if not isinstance(reward, RewardModel):
            return reward(features).numpy()
        paid, _ = reward.episode_rewards(features)
    return paid.numpy()


def _by_name(name: str, features: Tensor) -> Tensor:
    # Imported here: fitting somebody's data set needs no simulator.
    from gaitpref.raters.criterion_scores import criterion_context
    from gaitpref.training.total_reward import load_score
    from policy.training.setup import setting_of

    setting = setting_of(None, None)
    score = load_score(name, criterion_context(setting.robot, setting.env))
    starts = torch.zeros(len(features), 1, dtype=torch.bool)
    starts[0] = True
    return score(features[:, None], starts)[:, 0]
