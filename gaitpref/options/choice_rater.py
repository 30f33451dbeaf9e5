"""A simulated rater of choices: likes columns of the choice row, and errs a little."""

from __future__ import annotations

import hashlib
import uuid
from collections.abc import Mapping

import numpy as np
import torch

from data.answers.answer_records import Answer, Choice, Pair, now_utc
from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from data.errors import GaitprefError
from policy.options.choice_row import written_reward

from .choice_clips import ChoiceClips

_SURE = 4.0
"""Logits for a lead of one deviation among the clips."""
_NAMESPACE = uuid.UUID("5c2f4f3a-0f4b-4f7e-9f53-0d3a1b8a7c42")


def parse_wish(text: str) -> dict[str, float]:
    """Weights by column, of `NAME=NUMBER,NAME=NUMBER`.

    Raises:
        GaitprefError: it is none.
    """
    wish: dict[str, float] = {}
    for part in text.split(","):
        name, _, number = part.strip().partition("=")
        try:
            wish[name] = float(number)
        except ValueError:
            wish[name] = float("nan")
        if not np.isfinite(wish[name]):
            raise GaitprefError(
                f"--wish {part.strip()!r}: give NAME=NUMBER, as changes_per_s=-1"
            )
    return wish


def wisher_of(wish: Mapping[str, float]) -> str:
    """The rater who has this wish."""
    told = ",".join(f"{name}={weight!r}" for name, weight in sorted(wish.items()))
    return f"wish:{hashlib.sha256(told.encode()).hexdigest()[:12]}"


def answer_choices(
    dataset: Dataset,
    gaits: tuple[str, ...],
    wish: Mapping[str, float],
    *,
    count: int,
    seed: int,
) -> int:
    """Ask about `count` pairs of whole episodes of a data set, and let `wisher_of` the
    wish answer them; gives how many answers are new.

    Raises:
        GaitprefError: there are too few episodes, or the wish has an unknown column.
    """
    clips = [Clip(e.sha256, 0, e.num_steps) for e in dataset.entries()]
    if len(clips) * (len(clips) - 1) // 2 < count:
        raise GaitprefError(
            f"{len(clips)} episodes make fewer than {count} pairs: ask for fewer "
            "--answers"
        )
    reward = written_reward(wish, gaits, "wish")
    segments = ChoiceClips(dataset, gaits).segments(clips)
    # Behind the end of a segment it is NaN.
    worth = np.nanmean(reward(torch.from_numpy(segments.rows)).numpy(), axis=1)
    worth = worth / max(float(np.std(worth)), 1e-9)
    rng = np.random.default_rng([seed, 1])
    pairs: dict[str, tuple[int, int]] = {}
    made: list[Pair] = []
    while len(made) < count:
        left, right = (int(each) for each in rng.choice(len(clips), 2, replace=False))
        pair = Pair.make(clips[left], clips[right], strategy="uniform", round=0)
        if pair.pair_id not in pairs:
            pairs[pair.pair_id] = (left, right)
            made.append(pair)
    wisher = wisher_of(wish)
    with dataset.answers() as store:
        store.add_rater(wisher, "scripted", {"wish": dict(wish)})
        store.add_pairs(made)
        open_ids = {pair.pair_id for pair in store.unanswered(wisher)}
        todo = [pair for pair in made if pair.pair_id in open_ids]
        for pair in todo:
            left, right = pairs[pair.pair_id]
            lead = worth[left] - worth[right]
            own = np.random.default_rng([seed, _number(pair)])
            likes_left = own.random() < 1.0 / (1.0 + np.exp(-_SURE * lead))
            store.add_answer(_answer(pair, wisher, "a" if likes_left else "b"))
    return len(todo)


def _number(pair: Pair) -> int:
    return uuid.uuid5(_NAMESPACE, pair.pair_id).int % 2**32


def _answer(pair: Pair, wisher: str, choice: Choice) -> Answer:
    return Answer(
        answer_id=str(uuid.uuid5(_NAMESPACE, f"{pair.pair_id} {wisher}")),
        pair_id=pair.pair_id,
        rater_id=wisher,
        choice=choice,
        shown_left="a",
        created_utc=now_utc(),
    )
