"""Data sets of gaits with a planted taste, answered as somebody likes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from benchmarks.data import noise_episode
from data.answers.answer_records import Answer, Choice, Pair, Side
from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from rewardmodel import fold_of
from rewardmodel.answers.clip_batch import read_clips
from tests.rewardmodel.test_fit import gait, taste

STEPS = 20
EPISODES = 40

Say = Callable[[int, bool, Side], Choice]
"""What somebody says of the n-th pair, of which the taste likes clip a or not, where
that clip is shown on the side named."""


def gaits(root: Path, pairs: int) -> Dataset:
    """Episodes of one clip each, and pairs of them that a fold can be asked about."""
    rng = np.random.default_rng(0)
    dataset = Dataset.create(root)
    added = dataset.add_episodes(
        replace(noise_episode(seed, STEPS), features=gait(rng, STEPS))
        for seed in range(EPISODES)
    )
    folds: dict[int, list[Clip]] = {}
    for entry in added:
        clip = Clip(entry.sha256, 0, STEPS)
        folds.setdefault(fold_of(entry.sha256), []).append(clip)
    every = [
        Pair.make(a, b, strategy="uniform", round=0)
        for clips in folds.values()
        for number, a in enumerate(clips)
        for b in clips[:number]
    ]
    chosen = rng.permutation(len(every))[:pairs]
    assert len(chosen) == pairs
    with dataset.answers() as store:
        store.add_pairs([every[number] for number in chosen])
    return dataset


def fill(dataset: Dataset, rater: str, say: Say, *, times: int = 1) -> None:
    """Let somebody answer every pair, `times` each; sides are drawn by lot."""
    rng = np.random.default_rng([len(rater), *rater.encode()])
    with dataset.answers() as store:
        pairs = store.pairs()
        store.add_rater(rater, "human")
        clips = [clip for pair in pairs for clip in (pair.a, pair.b)]
        worth = taste(read_clips(clips, dataset.clip_features)).reshape(-1, 2)
        better = (worth[:, 0] > worth[:, 1]).tolist()
        with store.transaction():
            for number, pair in enumerate(pairs):
                for time in range(times):
                    left: Side = "a" if rng.random() < 0.5 else "b"
                    store.add_answer(
                        Answer(
                            answer_id=f"{rater}-{number}-{time}",
                            pair_id=pair.pair_id,
                            rater_id=rater,
                            choice=say(number + time, better[number], left),
                            shown_left=left,
                            created_utc="2030-01-31T12:00:00Z",
                        )
                    )


def honest(number: int, better: bool, left: Side) -> Choice:
    """Whoever looks."""
    return "a" if better else "b"


def at_random(number: int, better: bool, left: Side) -> Choice:
    """Whoever does not: the order of a generator, so that draws can be repeated."""
    generator = torch.Generator().manual_seed(number)
    return "a" if torch.rand(1, generator=generator) < 0.5 else "b"
