"""Recording, asking and answering, on a data set.

Shapes: T steps of a clip, F feature columns (`data.features.FEATURES`).
"""

from __future__ import annotations

import uuid
from collections.abc import Callable
from pathlib import Path

import numpy as np

from data.answers.answer_records import Answer, Choice, Pair, now_utc
from data.answers.strategy_names import StrategyName
from data.datasets.dataset import Dataset, EpisodeEntry
from data.datasets.gone import listed_in
from policy.rollouts.record import record as episodes_of
from policy.rollouts.record_cfg import RecordCfg
from rewardmodel.asking.clip_questions import ClipCfg
from rewardmodel.asking.clip_questions import ask as chosen
from rewardmodel.models.model import RewardModel

Judge = Callable[[np.ndarray, np.ndarray], Choice]
"""Feature rows [T, F] of clip a and of clip b; gives a, b, equal, skip or bad."""


def open_dataset(root: Path, *, create: bool = False) -> Dataset:
    """The data set in the directory `root`.

    Args:
        root: The directory.
        create: Make it where there is none.

    Raises:
        GaitprefError: there is none, or it cannot be used.
    """
    return Dataset.create(root) if create else Dataset.open(root)


def record(
    policy: Path,
    dataset: Dataset,
    *,
    episodes: int = 96,
    episode_s: float = RecordCfg.episode_s,
    round: int = 0,
    seed: int = 0,
) -> list[EpisodeEntry]:
    """Add episodes of a policy, and of the checkpoints beside it, to a data set.

    Args:
        policy: A `policy.pt`.
        dataset: Gets the episodes.
        episodes: How many.
        episode_s: Length of each.
        round: Stored with every episode.
        seed: Start states and exploration noise.

    Raises:
        GaitprefError: the policy or the data set cannot be used.
    """
    cfg = RecordCfg(episodes=episodes, episode_s=episode_s)
    return dataset.add_episodes(episodes_of(policy, cfg, seed=seed, round=round))


def ask(
    dataset: Dataset,
    count: int,
    *,
    reward: RewardModel | None = None,
    strategy: StrategyName = "uniform",
    clip_s: float = ClipCfg.clip_s,
    seed: int = 0,
) -> list[Pair]:
    """Choose `count` new pairs of clips, and add them to a data set.

    Args:
        dataset: Holds the episodes, and gets the pairs.
        count: How many.
        reward: What chooses them, where `strategy` needs one.
        strategy: How a pair is chosen.
        clip_s: Length of a clip.
        seed: Where all chance comes from.

    Raises:
        GaitprefError: the episodes give too few pairs.
    """
    with dataset.answers() as store:
        pairs = chosen(
            dataset,
            dataset.entries(),
            ClipCfg.of(clip_s),
            count,
            known=store.pairs(),
            model=reward,
            round_number=0,
            uniform_share=0.0,
            strategy=strategy,
            rng=np.random.default_rng(seed),
        )
        store.add_pairs(pairs)
    return pairs


def answer(dataset: Dataset, judge: Judge, *, rater_id: str) -> int:
    """Have `judge` answer every pair that `rater_id` has not answered; gives how many.

    Each answer is on the disk before the next pair is judged, so that a program that
    was killed goes on.

    Args:
        dataset: Holds pairs and episodes.
        judge: Sees both clips; which one is shown on the left does not matter to it.
        rater_id: Whose answers these are.

    Raises:
        GaitprefError: the data set cannot be used.
        ValueError: `judge` gave no answer there is.
    """
    listed = listed_in([dataset])
    with dataset.answers() as store:
        store.add_rater(rater_id, "scripted", {})
        pairs = [pair for pair in store.unanswered(rater_id) if listed(pair)]
        for pair in pairs:
            choice = judge(dataset.clip_features(pair.a), dataset.clip_features(pair.b))
            store.add_answer(_answer(pair, choice, rater_id))
    return len(pairs)


def _answer(pair: Pair, choice: Choice, rater_id: str) -> Answer:
    return Answer(
        answer_id=str(uuid.uuid4()),
        pair_id=pair.pair_id,
        rater_id=rater_id,
        choice=choice,
        shown_left="a",
        created_utc=now_utc(),
    )
