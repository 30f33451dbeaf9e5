"""Which pairs people can tell apart, and how different asked pairs are.

Shapes: C clips, K pairs, H habits.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from data.answers.answer_records import Pair
from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from data.episodes.visible_habits import (
    NOTICED,
    VISIBLE_HABITS,
    VisibleHabit,
    differing,
    most_different,
    visible_habits,
)
from data.files.telling import Tell, silent
from rewardmodel.acquisition.choose import ToldApart

_NAMED = 4
"""Habits that are named of a set of pairs."""


@dataclass(frozen=True, eq=False)
class Visible:
    """Tells which pairs differ by at least so much in some habit that is seen."""

    dataset: Dataset
    least: float = NOTICED
    """In differences that are just noticed."""
    tell: Tell = silent
    """Gets how many clips were looked at, of as many as are to be looked at by now."""
    _known: dict[Clip, np.ndarray] = field(default_factory=dict, init=False)

    def __call__(self, clips: Sequence[Clip], pairs: np.ndarray) -> np.ndarray:
        """[K] bool, of pairs [K, 2] of `clips`."""
        return most_different(self.habits(clips), pairs) >= self.least

    def habits(self, clips: Sequence[Clip]) -> np.ndarray:
        """[C, H] what is seen of the clips; each is read once."""
        new = [clip for clip in dict.fromkeys(clips) if clip not in self._known]
        of = len(self._known) + len(new)
        for index, rows in self.dataset.each_clip_features(new):
            self.tell(len(self._known), of)
            dt_s = self.dataset.entry(new[index].rollout).meta.control_dt_s
            self._known[new[index]] = visible_habits(rows, dt_s)
        rows = [self._known[clip] for clip in clips]
        return np.array(rows).reshape(len(rows), len(VISIBLE_HABITS))

    def share(self, pairs: Sequence[Pair]) -> float:
        """Share of `pairs` that differ by as much as was asked for; 1 of none."""
        found = self._differing(pairs)
        return sum(map(bool, found)) / len(found) if found else 1.0

    def told_of(self, pairs: Sequence[Pair]) -> str:
        """How many of `pairs` differ by as much as was asked for, and in what, in
        words."""
        found = self._differing(pairs)
        counts = Counter(habit.name for habits in found for habit in habits)
        named = ", ".join(f"{name} ({n})" for name, n in counts.most_common(_NAMED))
        seen = sum(map(bool, found))
        in_what = f", most often in {named}" if named else ""
        by = "" if self._asked == NOTICED else f"{self._asked:g} times "
        return f"{seen} of {len(pairs)} pairs differ by {by}what people notice{in_what}"

    @property
    def _asked(self) -> float:
        """What is told of differs by this; by what is noticed where any two will do."""
        return self.least or NOTICED

    def _differing(self, pairs: Sequence[Pair]) -> list[list[VisibleHabit]]:
        sides = zip(
            self.habits([pair.a for pair in pairs]),
            self.habits([pair.b for pair in pairs]),
            strict=True,
        )
        return [differing(left, right, self._asked) for left, right in sides]


def showing(episodes: Collection[str], told_apart: ToldApart) -> ToldApart:
    """Tells which pairs have a clip of `episodes`, by their SHA-256, and can be
    `told_apart`."""

    def marked(clips: Sequence[Clip], pairs: np.ndarray) -> np.ndarray:
        of_these = np.array([clip.rollout in episodes for clip in clips], dtype=bool)
        return np.logical_and(of_these[pairs].any(axis=1), told_apart(clips, pairs))

    return marked
