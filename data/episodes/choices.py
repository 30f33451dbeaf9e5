"""Which gait ran when: a line of text beside the steps of an episode.

It stands in `EpisodeMeta.extra`, so that files of policies that choose are episodes
like all others. Shapes: T steps of the episode.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

GAITS, GAIT_RUNS = "gaits", "gait_runs"
"""Names in `EpisodeMeta.extra`: of the gaits, and how long each ran."""
COURSE = "course"
"""Name in `EpisodeMeta.extra` of the course that was walked on, as JSON."""
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,30}")
"""What a gait may be called."""
_RUN = re.compile(r"(\d{1,4})x(\d{1,7})")
_MOST_RUNS = 100_000


@dataclass(frozen=True, eq=False)
class Choices:
    """The gaits of an episode."""

    names: tuple[str, ...]
    gait: np.ndarray
    """[T] which of them ran."""

    def runs(self, rows: slice = slice(None)) -> list[tuple[str, int, int]]:
        """Name, first step and step behind the last of every gait, counted from the
        first of `rows`."""
        gait = self.gait[rows]
        edges = np.flatnonzero(np.diff(gait)) + 1
        bounds = [0, *edges.tolist(), len(gait)]
        return [
            (self.names[int(gait[first])], first, last)
            for first, last in itertools.pairwise(bounds)
            if last > first
        ]


def told_choices(names: Sequence[str], gait: np.ndarray) -> dict[str, str]:
    """What an episode says of its `gait` [T], for `extra`."""
    edges = np.flatnonzero(np.diff(gait)) + 1
    bounds = [0, *edges.tolist(), len(gait)]
    runs = [
        f"{int(gait[first])}x{last - first}"
        for first, last in itertools.pairwise(bounds)
    ]
    return {GAITS: ",".join(names), GAIT_RUNS: " ".join(runs)}


def choices_of(extra: Mapping[str, str], num_steps: int) -> Choices | None:
    """The gaits of an episode of `num_steps`; None where it says nothing usable."""
    names = tuple(extra.get(GAITS, "").split(","))
    runs = extra.get(GAIT_RUNS, "").split()
    found = [_RUN.fullmatch(run) for run in runs[:_MOST_RUNS]]
    if not all(map(NAME.fullmatch, names)) or None in found or not found:
        return None
    pairs = [(int(run[1]), int(run[2])) for run in found if run]
    if sum(steps for _, steps in pairs) != num_steps:
        return None
    if max(gait for gait, _ in pairs) >= len(names):
        return None
    return Choices(names, np.repeat(*np.array(pairs).T))
