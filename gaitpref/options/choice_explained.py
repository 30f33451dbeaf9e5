"""Which moment and which column of the choice row a reward of choices likes.

Shapes: K steps, C columns of a choice row, G of them that matter.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from data.datasets.dataset import Dataset
from data.episodes.choices import choices_of
from data.episodes.clips import Clip
from policy.options.choice_row import ChoiceReward
from rewardmodel.explain.attribution import Explanation
from rewardmodel.explain.credit import Side

from .choice_clips import rows_of_episode
from .choice_sets import require_about
from .choice_storage import gaits_of


def explain_choices(reward: ChoiceReward, rows: Tensor) -> Explanation:
    """Share the reward of the steps of a clip with choice rows [K, C].

    Shares are exact: it is a sum over columns.
    """
    shares = rows * torch.tensor(reward.linear)
    if reward.square:
        shares = shares + rows.square() * torch.tensor(reward.square)
    matters = (shares != 0).any(dim=0)
    kept = np.flatnonzero(matters.numpy())
    return Explanation(
        reward=reward(rows).numpy(),
        spread=np.zeros(len(rows), dtype=np.float32),
        groups=tuple(reward.names[column] for column in kept),
        shares=shares[:, matters].numpy(),
        descriptors=shares.numpy(),
        names=reward.names,
        average=reward.shift,
        method="exact",
    )


@dataclass(frozen=True, eq=False)
class OfChoices:
    """A reward of choices as what says of a clip what moved it (`Crediting`)."""

    reward: ChoiceReward
    fall_price: float = 0.0
    """A fall has none: nothing is paid after it."""

    def side(self, dataset: Dataset, clip: Clip) -> Side:
        """A clip of a data set.

        Raises:
            GaitprefError: it is of no choices among the gaits that the reward knows, of
                another robot or another rate.
        """
        rows = _rows(dataset, clip.rollout, gaits_of(self.reward))[clip.rows]
        entry = dataset.entry(clip.rollout)
        require_about(self.reward, entry.meta, str(dataset.root))
        chosen = choices_of(entry.meta.extra, entry.num_steps)
        assert chosen is not None
        return Side(
            shown=explain_choices(self.reward, torch.tensor(rows)),
            scored=np.ones(len(rows), dtype=bool),
            fell=False,
            runs=chosen.runs(clip.rows),
        )


@lru_cache(maxsize=2)
def _rows(dataset: Dataset, sha256: str, gaits: tuple[str, ...]) -> np.ndarray:
    """Rows of an episode, of which clips are mostly asked one after the other."""
    return rows_of_episode(dataset.read(sha256), gaits)
