"""Clips in the order in which a reward likes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data.datasets.dataset import Dataset, EpisodeEntry
from data.episodes.clips import Clip
from data.errors import GaitprefError
from data.files.telling import Tell, silent
from rewardmodel.answers.clip_batch import fill_clips, mean_over, with_past
from rewardmodel.asking.clip_questions import ClipCfg, clips_of
from rewardmodel.models.model import RewardModel

_BATCH = 256


@dataclass(frozen=True)
class Ranked:
    """A clip and what the reward makes of it."""

    clip: Clip
    reward: float
    """Mean over the steps that count, less the price of a fall, in units of the
    reward."""


def extremes(
    model: RewardModel,
    dataset: Dataset,
    count: int,
    *,
    entries: Sequence[EpisodeEntry] | None = None,
    tell: Tell = silent,
) -> list[tuple[str, Ranked]]:
    """The best and the worst `count` clips, each of another episode, with a name.

    Of `entries` alone, where they are given. `tell` gets the clips that are read.

    Raises:
        GaitprefError: the data set gives no clip.
    """
    clips = clips_of(dataset.entries() if entries is None else entries, ClipCfg())
    if not clips:
        raise GaitprefError(
            f"{dataset.root} gives no clip: `gaitpref record --policy POLICY "
            f"--dataset {dataset.root}` adds episodes"
        )
    found = sorted(
        ranked(model, dataset, clips, tell), key=lambda r: (-r.reward, r.clip)
    )
    best = _of_other_episodes(found, count)
    worst = _of_other_episodes(found[::-1], count)
    return [
        (f"{name}-{place + 1}", clip)
        for name, part in (("best", best), ("worst", worst))
        for place, clip in enumerate(part)
    ]


def ranked(
    model: RewardModel, dataset: Dataset, clips: list[Clip], tell: Tell = silent
) -> list[Ranked]:
    """What the reward makes of each clip, in the order the files are read; `tell` gets
    how many are."""
    found: list[Ranked] = []
    rows: list[tuple[int, np.ndarray]] = []
    for item in dataset.each_clip_features([with_past(clip) for clip in clips]):
        rows.append(item)
        tell(len(found) + len(rows), len(clips))
        if len(rows) == _BATCH:
            found += _scored(model, clips, rows)
            rows = []
    return found + (_scored(model, clips, rows) if rows else [])


def _scored(
    model: RewardModel, clips: list[Clip], rows: list[tuple[int, np.ndarray]]
) -> list[Ranked]:
    steps = [clips[position].steps for position, _ in rows]
    batch = fill_clips(steps, enumerate(features for _, features in rows))
    rewards, _ = model.clip_rewards(batch)
    price = model.provenance.cfg.fall_logit / model.reward_std
    values = mean_over(rewards, batch.scored) - price * batch.fell.float()
    return [
        Ranked(clips[position], value)
        for (position, _), value in zip(rows, values.tolist(), strict=True)
    ]


def _of_other_episodes(found: list[Ranked], count: int) -> list[Ranked]:
    first: dict[str, Ranked] = {}
    for item in found:
        first.setdefault(item.clip.rollout, item)
    return list(first.values())[:count]
