"""The simulated rater: answers open pairs from a criterion the learner never sees."""

from __future__ import annotations

import datetime
import math
import uuid

import numpy as np
import torch

from data.answers import Answer, Choice, Pair
from data.clips import Clip
from data.dataset import Dataset

from .criteria import Criterion

RATER_NAMESPACE = uuid.UUID("8d2c7f5e-27d3-4a6e-9a53-6a2f5d0c1b11")


def clip_score(dataset: Dataset, clip: Clip, criterion: Criterion) -> float:
    """Mean score over the steps the clip really has, whatever its length."""
    rows = dataset.features(clip.rollout)[clip.start : clip.start + clip.steps]
    with torch.inference_mode():
        return float(criterion(torch.tensor(rows)).double().mean())


def judge(score_a: float, score_b: float) -> Choice:
    """The better clip; equal where the scores are, up to rounding.

    A criterion that needs a feature nobody measured gives NaN: then nobody can tell.
    """
    if math.isnan(score_a) or math.isnan(score_b):
        return "skip"
    if abs(score_a - score_b) <= 1e-6 * max(abs(score_a), abs(score_b), 1e-6):
        return "equal"
    return "a" if score_a > score_b else "b"


def answer_pairs(
    dataset: Dataset,
    criterion: Criterion,
    *,
    rater_id: str,
    seed: int,
    round: int | None = None,
) -> int:
    """Answer every pair `rater_id` has not answered yet; gives how many.

    An answer's id follows from pair and rater, so that a killed run answers no pair
    twice.
    """
    with dataset.answers() as store:
        store.add_rater(rater_id, "scripted", {})
        pairs = store.unanswered(rater_id, round=round)
        for pair in pairs:
            store.add_answer(_answer(dataset, pair, criterion, rater_id, seed))
        return len(pairs)


def _answer(
    dataset: Dataset, pair: Pair, criterion: Criterion, rater_id: str, seed: int
) -> Answer:
    scores = [clip_score(dataset, clip, criterion) for clip in (pair.a, pair.b)]
    answer_id = uuid.uuid5(RATER_NAMESPACE, f"{pair.pair_id} {rater_id}")
    rng = np.random.default_rng([seed, answer_id.int % 2**32])
    return Answer(
        answer_id=str(answer_id),
        pair_id=pair.pair_id,
        rater_id=rater_id,
        choice=judge(*scores),
        shown_left="a" if rng.random() < 0.5 else "b",
        created_utc=datetime.datetime.now(datetime.UTC).isoformat(
            timespec="milliseconds"
        ),
    )
