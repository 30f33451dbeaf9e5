"""The simulated rater: answers open pairs from a criterion the learner never sees."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Iterable

import numpy as np
import torch

from data.answers.answer_records import Answer, Pair, now_utc
from data.datasets.dataset import Dataset
from data.datasets.gone import listed_in
from data.episodes.clips import Clip

from .criteria import Criterion
from .criterion_scores import score_of_criterion
from .error_model import Standards, judge, said_why, standards
from .rater_cfg import RaterCfg

PERFECT = RaterCfg()
RATER_NAMESPACE = uuid.UUID("8d2c7f5e-27d3-4a6e-9a53-6a2f5d0c1b11")


class ClipScores:
    """Scores of clips, step by step; each episode is scored once, from its start."""

    def __init__(
        self, features_of: Callable[[str], np.ndarray], criterion: Criterion
    ) -> None:
        self._features_of = features_of
        self._score = score_of_criterion(criterion)
        self._episodes: dict[str, np.ndarray] = {}

    def __call__(self, clip: Clip) -> np.ndarray:
        """Scores [T] of the steps the clip really has, whatever its length."""
        if clip.rollout not in self._episodes:
            rows = torch.tensor(self._features_of(clip.rollout))[:, None]
            starts = torch.zeros(rows.shape[:2], dtype=torch.bool)
            starts[0] = True
            with torch.inference_mode():
                scores = self._score(rows, starts)[:, 0].double()
            self._episodes[clip.rollout] = scores.numpy()
        return self._episodes[clip.rollout][clip.rows]


def answer_pairs(
    dataset: Dataset,
    criterion: Criterion,
    *,
    rater_id: str,
    seed: int,
    cfg: RaterCfg = PERFECT,
    round: int | None = None,
    features_of: Callable[[str], np.ndarray] | None = None,
    tell: Callable[[int, int], None] = lambda done, of: None,
) -> int:
    """Answer every pair `rater_id` has not answered yet; gives how many. Pairs whose
    episode is gone are left open.

    `features_of` gives the rows of an episode, where the criterion is of others than
    the feature rows of the data set.

    An answer's id follows from pair and rater, and its chance from the id, so that a
    killed run answers no pair twice and none otherwise.
    """
    scores = ClipScores(features_of or dataset.features, criterion)
    with dataset.answers() as store:
        store.add_rater(rater_id, "scripted", {})
        listed = listed_in([dataset])
        pairs = [p for p in store.unanswered(rater_id, round=round) if listed(p)]
        if pairs:
            known = standards_among(filter(listed, store.pairs()), scores, cfg)
            for done, pair in enumerate(pairs):
                tell(done, len(pairs))
                store.add_answer(_answer(pair, scores, cfg, known, rater_id, seed))
        return len(pairs)


def standards_among(
    pairs: Iterable[Pair], scores: ClipScores, cfg: RaterCfg
) -> Standards:
    """What a rater who was asked `pairs` compares with."""
    if cfg == PERFECT:
        return Standards(1.0, -np.inf)  # Nothing is compared with them.
    pairs = list(pairs)
    clips = {clip: float(scores(clip).mean()) for p in pairs for clip in (p.a, p.b)}
    leads = [clips[pair.a] - clips[pair.b] for pair in pairs]
    return standards(leads, list(clips.values()), cfg.skip)


def _answer(
    pair: Pair,
    scores: ClipScores,
    cfg: RaterCfg,
    known: Standards,
    rater_id: str,
    seed: int,
) -> Answer:
    answer_id = uuid.uuid5(RATER_NAMESPACE, f"{pair.pair_id} {rater_id}")
    rng = np.random.default_rng([seed, answer_id.int % 2**32])
    shown_left = "a" if rng.random() < 0.5 else "b"
    choice = judge(scores(pair.a), scores(pair.b), cfg, known, rng)
    return Answer(
        answer_id=str(answer_id),
        pair_id=pair.pair_id,
        rater_id=rater_id,
        choice=choice,
        shown_left=shown_left,
        created_utc=now_utc(),
        why=said_why(cfg, rng) if choice in ("a", "b") else "",
    )
