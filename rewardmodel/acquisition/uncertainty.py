"""The strategy that asks where an ensemble is unsure.

Shapes: C clips, K candidate pairs (two indices into the clips each), M members.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from torch import Tensor

from data.episodes.clips import Clip
from rewardmodel.answers.clip_batch import ClipBatch, ClipRows, read_clips
from rewardmodel.models.model import RewardModel


@dataclass(frozen=True)
class Disagreement:
    """Standard deviation over the ensemble of the probability that left is better."""

    model: RewardModel
    clip_rows: ClipRows
    name: str = "disagreement"

    def __call__(
        self, clips: Sequence[Clip], candidates: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        leads = leads_of(self.model, self.clip_rows, clips, candidates)
        return leads.sigmoid().std(dim=0).numpy()


def leads_of(
    model: RewardModel,
    clip_rows: ClipRows,
    clips: Sequence[Clip],
    candidates: np.ndarray,
) -> Tensor:
    """Logit [M, K], by member, that the left clip of each candidate is better."""
    used, pairs = used_clips(clip_rows, clips, candidates)
    returns = model.clip_returns(used)  # [M, C]
    left, right = pairs.T
    return returns[:, left] - returns[:, right]


def used_clips(
    clip_rows: ClipRows, clips: Sequence[Clip], candidates: np.ndarray
) -> tuple[ClipBatch, np.ndarray]:
    """The clips some candidate has, and candidates [K, 2] that index these."""
    used, positions = np.unique(candidates, return_inverse=True)
    batch = read_clips([clips[index] for index in used], clip_rows)
    return batch, positions.reshape(candidates.shape)
