"""Strategies that look at a batch as a whole: no two questions about the same doubt.

A pair is placed by the difference of its clips' mean descriptors; which clip is left
does not matter, so that a difference and its negative are the same place. Each strategy
picks greedily, and a candidate is worth what it added when it was picked: any number of
the first ones is a batch. So a batch stays good when many raters answer at once.

Shapes: C clips, K candidate pairs (two indices into the clips each), D descriptors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data.episodes.clips import Clip
from rewardmodel.acquisition.strategy import Strategy
from rewardmodel.answers.clip_batch import ClipRows, mean_over, pad_clips
from rewardmodel.descriptors.normaliser import Normaliser, fill_missing
from rewardmodel.descriptors.table import describe

_PICKED_SHARE = 0.3
"""Share of many candidates that are picked one by one: three times those asked."""
_ALWAYS_PICKED = 100


@dataclass(frozen=True)
class KCenter:
    """Distance to the nearest pair picked before, the farthest first.

    The first centre is a pair of equal clips, which teaches nothing.
    """

    clip_rows: ClipRows
    among: Strategy | None = None
    """Only the better half by this strategy is looked at."""
    name: str = "kcenter"

    def __call__(
        self, clips: Sequence[Clip], candidates: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        places = differences(self.clip_rows, clips, candidates)
        open_ = np.ones(len(candidates), dtype=bool)
        if self.among is not None:
            doubt = self.among(clips, candidates, rng)
            open_[np.argsort(-doubt, kind="stable")[(len(doubt) + 1) // 2 :]] = False
        nearest = np.where(open_, np.linalg.norm(places, axis=1), -np.inf)
        worth = np.full(len(candidates), -1.0)
        for _ in range(int(open_.sum())):
            picked = int(nearest.argmax())
            worth[picked] = nearest[picked]
            nearest = np.minimum(nearest, _distances(places, places[picked]))
            nearest[picked] = -np.inf
        return worth


@dataclass(frozen=True)
class Medoids:
    """How much better a pair lets the picked ones stand for all candidates.

    Every candidate is stood for by the picked pair nearest to it: a common difference
    is asked about before a rare one, and once.
    """

    clip_rows: ClipRows
    name: str = "medoids"

    def __call__(
        self, clips: Sequence[Clip], candidates: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        places = differences(self.clip_rows, clips, candidates)
        apart = np.stack([_distances(places, place) for place in places])
        usual = np.median(apart) or 1.0
        alike = np.exp(-0.5 * np.square(apart / usual))
        stood_for = np.zeros(len(candidates))
        worth = np.zeros(len(candidates))
        left = np.ones(len(candidates), dtype=bool)
        for _ in range(_picks(len(candidates))):
            gains = np.maximum(alike - stood_for, 0.0).sum(axis=1)
            picked = int(np.where(left, gains, -1.0).argmax())
            worth[picked], left[picked] = gains[picked], False
            stood_for = np.maximum(stood_for, alike[picked])
        return worth


@dataclass(frozen=True)
class Dpp:
    """Greedy mode of a determinantal point process: worth asking, and unlike the rest.

    The kernel is q_i q_j cos^2(angle between i and j); picking the greatest conditional
    variance each time follows Chen, Zhang and Zhou (2018). A pair in the same
    direction as one picked before adds nothing, whatever its quality q.
    """

    clip_rows: ClipRows
    quality: Strategy | None = None
    """Gives q; by default the distance between the clips."""
    name: str = "dpp"

    def __call__(
        self, clips: Sequence[Clip], candidates: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        places = differences(self.clip_rows, clips, candidates)
        length = np.linalg.norm(places, axis=1)
        quality = length
        if self.quality is not None:
            quality = self.quality(clips, candidates, rng).astype(float)
        directions = places / np.maximum(length, 1e-9)[:, None]
        variance = np.square(quality) * np.square((directions**2).sum(axis=1))
        factors = np.zeros((_picks(len(candidates)), len(candidates)))
        worth = np.zeros(len(candidates))
        left = np.ones(len(candidates), dtype=bool)
        for step in range(len(factors)):
            picked = int(np.where(left, variance, -1.0).argmax())
            if variance[picked] <= 1e-12:
                break
            worth[picked], left[picked] = variance[picked], False
            angle = directions @ directions[picked]
            kernel = quality * quality[picked] * np.square(angle)
            known = factors[:step].T @ factors[:step, picked]
            factors[step] = (kernel - known) / np.sqrt(variance[picked])
            variance = np.maximum(variance - np.square(factors[step]), 0.0)
        return worth


def differences(
    clip_rows: ClipRows, clips: Sequence[Clip], candidates: np.ndarray
) -> np.ndarray:
    """[K, D] standardised mean descriptors of left clips less those of right ones."""
    used, positions = np.unique(candidates, return_inverse=True)
    batch = pad_clips([clip_rows(clips[index]) for index in used])
    described = describe(batch.features)
    normaliser = Normaliser(described.shape[-1]).fit(described[batch.scored])
    standardised = fill_missing(normaliser(described))
    means = mean_over(standardised.mT, batch.scored[:, None]).numpy()
    left, right = positions.reshape(candidates.shape).T
    return (means[left] - means[right]).astype(float)


def _distances(places: np.ndarray, place: np.ndarray) -> np.ndarray:
    """[K] distance of places [K, D] to one [D], or to its mirror image if nearer."""
    return np.minimum(
        np.linalg.norm(places - place, axis=1), np.linalg.norm(places + place, axis=1)
    )


def _picks(count: int) -> int:
    return min(count, max(_ALWAYS_PICKED, round(_PICKED_SHARE * count)))
