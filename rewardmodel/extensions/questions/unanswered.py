"""Pairs nobody was asked about, for a fit that also hears its own opinion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from data.answers.answer_records import Pair
from data.datasets.dataset import Dataset
from data.episodes.clips import cut_clips
from rewardmodel.acquisition.choose import NothingToCompare, choose_pairs
from rewardmodel.acquisition.strategy import Uniform
from rewardmodel.answers.answered_pairs import AnsweredPairs, gather_pairs
from rewardmodel.extensions_cfg import SemiSupervisedCfg


def unanswered_pairs(
    datasets: Sequence[Dataset],
    answered: AnsweredPairs,
    cfg: SemiSupervisedCfg,
    *,
    rng: np.random.Generator,
) -> AnsweredPairs | None:
    """Pairs of equal command that nobody was asked about, drawn at random.

    Clips are as long as the longest that was judged. None if everybody was asked about
    all there are. A data set may have nothing to compare where another has.

    Args:
        datasets: Where the answers came from.
        answered: The answers.
        cfg: How many pairs for each of them.
        rng: Which ones.

    Raises:
        NothingToCompare: no data set has two clips that can be compared.
        RewardError, DatasetError, EpisodeError: as for `load_pairs`.
    """
    steps = answered.left.valid.shape[1]
    wanted = max(1, cfg.pairs_per_answer * len(answered) // len(datasets))
    chosen: list[Pair] = []
    refused: NothingToCompare | None = None
    for dataset in datasets:
        entries = dataset.entries()
        with dataset.answers_copy() as store:
            known = store.pairs()
        # As the loop cuts them: a shorter clip shows nothing but its fall.
        lengths = {"stride": max(1, steps // 2), "min_steps": max(1, steps // 3)}
        clips = cut_clips(entries, steps=steps, **lengths)
        try:
            chosen += choose_pairs(
                entries,
                clips,
                wanted,
                strategy=Uniform(),
                round=0,
                known_pairs=known,
                rng=rng,
            )
        except NothingToCompare as error:
            refused = error
    if refused and not chosen:
        raise refused
    return gather_pairs(datasets, chosen) if chosen else None
