"""What is in a data set, counted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from data.answers.answer_records import Answer, Pair

from .dataset import Dataset
from .manifest import models_of


@dataclass(frozen=True)
class AnswerCount:
    """Current answers of one rater in one round."""

    rater: str
    round: int
    answers: int
    preferences: int
    """Answers that prefer a clip or call both equal."""


@dataclass(frozen=True)
class Overview:
    """A data set at a glance."""

    episodes: int
    steps: int
    hours: float
    """Hours of robot time."""
    bytes: int
    """Of the episodes and of the models that lie beside them."""
    falls: int
    """Episodes that ended by a fall."""
    aborted: int
    robots: dict[str, int]
    """Episodes by robot; likewise below."""
    tasks: dict[str, int]
    policies: dict[str, int]
    commands: dict[str, int]
    """By forward m/s, left m/s, yaw rad/s."""
    pairs: int
    answers: tuple[AnswerCount, ...]


def overview(dataset: Dataset) -> Overview:
    """Count episodes and answers.

    Raises:
        DatasetError, AnswerError: manifest or answers cannot be used.
    """
    entries = dataset.entries()
    metas = [entry.meta for entry in entries]
    with dataset.answers_copy() as store:
        num_pairs = len(store.pairs())
        current = store.current_answers()
    return Overview(
        episodes=len(entries),
        steps=sum(entry.num_steps for entry in entries),
        hours=sum(e.num_steps * e.meta.control_dt_s for e in entries) / 3600,
        bytes=sum(entry.bytes for entry in entries)
        + sum(map(dataset.models.size, models_of(entries))),
        falls=sum(entry.end_reason == "terminated" for entry in entries),
        aborted=sum(entry.end_reason == "aborted" for entry in entries),
        robots=_counted(meta.robot for meta in metas),
        tasks=_counted(meta.task for meta in metas),
        policies=_counted(meta.policy_sha256 for meta in metas),
        commands=_counted(", ".join(f"{v:g}" for v in meta.command) for meta in metas),
        pairs=num_pairs,
        answers=_by_rater_and_round(current),
    )


def _counted(values: Iterable[str]) -> dict[str, int]:
    return dict(sorted(Counter(values).items()))


def _by_rater_and_round(
    current: list[tuple[Pair, Answer]],
) -> tuple[AnswerCount, ...]:
    answers: Counter[tuple[str, int]] = Counter()
    preferences: Counter[tuple[str, int]] = Counter()
    for pair, answer in current:
        answers[answer.rater_id, pair.round] += 1
        preferences[answer.rater_id, pair.round] += answer.target is not None
    return tuple(
        AnswerCount(rater, round, count, preferences[rater, round])
        for (rater, round), count in sorted(answers.items())
    )
