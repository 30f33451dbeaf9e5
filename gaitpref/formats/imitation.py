"""Answers out of a `PreferenceDataset` that the package imitation saved.

Its fragments carry observations and actions, not where they come from; they are looked
up in the episodes of the data set.

Shapes: T steps of a fragment.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from data.answers.answer_records import Answer, Choice, Pair
from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from data.errors import DatasetError
from data.files.telling import Tell, silent

from .pickles import load_plain_pickle
from .uni_rlhf import add_answers, imported_answer

_RECORDS = frozenset(
    {
        ("imitation.algorithms.preference_comparisons", "PreferenceDataset"),
        ("imitation.data.types", "Trajectory"),
        ("imitation.data.types", "TrajectoryWithRew"),
    }
)


def import_imitation(
    dataset: Dataset, path: Path, rater_id: str, tell: Tell = silent
) -> int:
    """Add the preferences of a saved `PreferenceDataset`; gives how many were new.

    `tell` gets the episodes they are looked for in.

    Raises:
        DatasetError: the file is damaged or refused, or a fragment is in no episode.
    """
    saved = load_plain_pickle(path, records=_RECORDS)
    try:
        left, right = list(saved.fragments1), list(saved.fragments2)
        targets = np.asarray(saved.preferences, dtype=float)
        if not (len(left) == len(right) == len(targets)):
            raise ValueError("its lists have different lengths")
        if not ((targets >= 0) & (targets <= 1)).all():
            raise ValueError("a preference is no probability")
        index = _Index(dataset, tell)
        rows: list[tuple[Pair, Answer]] = []
        for number, (a, b, p_a) in enumerate(zip(left, right, targets, strict=True)):
            clips = [index.clip(fragment, path) for fragment in (a, b)]
            pair = Pair.make(clips[0], clips[1], strategy="imitation", round=0)
            choice: Choice = "equal" if p_a == 0.5 else ("a" if p_a > 0.5 else "b")
            answer = imported_answer(pair, rater_id, number, choice)
            rows.append((pair, replace(answer, p_a=float(p_a))))
    except (AttributeError, TypeError, ValueError) as error:
        raise DatasetError(
            f"{path} is no PreferenceDataset of imitation ({error})"
        ) from None
    return add_answers(dataset, rater_id, rows)


class _Index:
    """Finds a stretch of actions and observations in the episodes of a data set."""

    def __init__(self, dataset: Dataset, tell: Tell) -> None:
        self._dataset = dataset
        self._steps: dict[bytes, list[tuple[str, int]]] = defaultdict(list)
        entries = dataset.entries()
        for done, entry in enumerate(entries):
            tell(done, len(entries))
            episode = dataset.read(entry.sha256)
            for step in range(episode.num_steps):
                key = episode.obs[step].tobytes() + episode.action[step].tobytes()
                self._steps[key].append((entry.sha256, step))

    def clip(self, fragment: Any, path: Path) -> Clip:
        """The clip a fragment shows, to the last bit.

        Raises:
            DatasetError: no episode holds it.
        """
        obs = np.asarray(fragment.obs, dtype=np.float32)
        acts = np.asarray(fragment.acts, dtype=np.float32)
        if len(acts) == 0 or len(obs) != len(acts) + 1:
            raise ValueError("a fragment needs one observation more than actions")
        key = obs[0].tobytes() + acts[0].tobytes()
        for sha256, start in self._steps.get(key, ()):
            episode = self._dataset.read(sha256)
            steps = slice(start, start + len(acts))
            states = slice(start, start + len(obs))
            if np.array_equal(episode.action[steps], acts) and np.array_equal(
                episode.obs[states], obs
            ):
                return Clip(sha256, start, len(acts))
        raise DatasetError(
            f"a fragment of {path} is in no episode of {self._dataset.root}; merge the "
            "data set it was cut from"
        )
