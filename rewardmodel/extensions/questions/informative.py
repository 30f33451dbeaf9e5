"""Strategies that ask an ensemble what an answer would tell.

Shapes: C clips, K candidate pairs (two indices into the clips each), M members.
Stacked values [3, ...] are left, right, tie.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from data.episodes.clips import Clip
from data.features import column
from rewardmodel.acquisition.uncertainty import leads_of, used_clips
from rewardmodel.answers.clip_batch import ClipRows
from rewardmodel.answers.likelihood import answer_log_probabilities
from rewardmodel.models.model import RewardModel


@dataclass(frozen=True)
class Entropy:
    """Entropy, in nats, of the answer the ensemble expects on average.

    High wherever the answer is open, also where no answer would teach anything because
    all members agree that the clips are equally good.
    """

    model: RewardModel
    clip_rows: ClipRows
    name: str = "entropy"

    def __call__(
        self, clips: Sequence[Clip], candidates: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        leads = leads_of(self.model, self.clip_rows, clips, candidates)
        return _entropy(_answers(self.model, leads).mean(dim=1)).numpy()


@dataclass(frozen=True)
class Bald:
    """Mutual information, in nats, of the answer and the member that is right.

    The entropy of the answer less what would remain if one knew the right member
    (Houlsby et al. 2011), under the likelihood the model was fitted with: errors and
    ties that are expected anyway are worth nothing.
    """

    model: RewardModel
    clip_rows: ClipRows
    name: str = "bald"

    def __call__(
        self, clips: Sequence[Clip], candidates: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        leads = leads_of(self.model, self.clip_rows, clips, candidates)
        answers = _answers(self.model, leads)  # [3, M, K]
        whole, within = _entropy(answers.mean(dim=1)), _entropy(answers)
        return (whole - within.mean(dim=0)).clamp_min(0.0).numpy()


@dataclass(frozen=True)
class Improvement:
    """Expected improvement: by how much the better clip of a pair should beat the best
    known under its command, in units of the reward.

    The best known is the clip the ensemble thinks best on average; the better of a pair
    is told by the answer, so that it is worth the mean over the ensemble of the greater
    return (expected utility of the best option: Astudillo et al. 2023, EUBO). Doubt
    about bad motion is not asked about: no policy will be trained to do it.
    """

    model: RewardModel
    clip_rows: ClipRows
    name: str = "improvement"

    def __call__(
        self, clips: Sequence[Clip], candidates: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        used, pairs = used_clips(self.clip_rows, clips, candidates)
        returns = self.model.clip_returns(used)  # [M, C]
        asked_for = used.features[:, 0, column("command")].numpy()
        _, groups = np.unique(asked_for, axis=0, return_inverse=True)
        worth = np.zeros(len(candidates))
        for group in np.unique(groups):
            own = torch.from_numpy(groups == group)
            # A member's zero means nothing: it is put at its mean under the command.
            utility = returns - returns[:, own].mean(dim=1, keepdim=True)
            best_known = utility.mean(dim=0)[own].max()
            inside = groups[pairs[:, 0]] == group
            either = utility[:, torch.from_numpy(pairs[inside])]  # [M, K, 2]
            worth[inside] = (either.amax(dim=-1).mean(dim=0) - best_known).numpy()
        return worth


def _answers(model: RewardModel, leads: Tensor) -> Tensor:
    """Probabilities [3, M, K] of the answers at leads [M, K]."""
    cfg = model.provenance.cfg
    return answer_log_probabilities(
        leads, tie_threshold=cfg.tie_threshold, error_share=cfg.error_share
    ).exp()


def _entropy(probabilities: Tensor) -> Tensor:
    """Entropy [...] of distributions [3, ...], in nats."""
    return -torch.xlogy(probabilities, probabilities).sum(dim=0)
