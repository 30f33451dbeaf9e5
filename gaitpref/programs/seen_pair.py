"""What a program is shown of a pair of clips, and what it says.

Shapes: T steps of a clip, F feature columns, H, W of a picture in pixels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np

from data.answers.answer_records import Pair, Side
from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from data.features import column
from gaitpref.film.shot import Shot, shot_of

from .strips import film_strip, footfall_strip, key_frames, key_steps

Word = Literal["left", "right", "equal", "skip"]
"""`skip`: it cannot tell."""
WORDS: tuple[Word, ...] = get_args(Word)
SWAPPED: dict[Word, Word] = {"left": "right", "right": "left"}


@dataclass(frozen=True, eq=False, kw_only=True)
class SeenClip:
    """One clip of a pair."""

    features: np.ndarray
    """[T, F] float32 rows; a feature that was not measured is NaN."""
    dt_s: float
    """Time from one row to the next."""
    shot: Shot
    """Its states, as one films them."""
    fell: bool
    """Whether it ends in a fall."""

    def column(self, name: str) -> np.ndarray:
        """[T, width] of one feature, as `base_height`.

        Raises:
            ValueError: there is no such feature.
        """
        return self.features[:, column(name)]

    @cached_property
    def frames(self) -> tuple[np.ndarray, ...]:
        """Eight pictures [H, W, 3] uint8, evenly spaced in time."""
        return key_frames(self.shot)

    @cached_property
    def film_strip(self) -> np.ndarray:
        """[H, W, 3] uint8: the same as one picture, with times."""
        times_s = key_steps(len(self.features)) * self.dt_s
        return film_strip(self.frames, times_s)

    @cached_property
    def footfalls(self) -> np.ndarray:
        """[H, W, 3] uint8: which foot is down when, a row a leg: FR, FL, RR, RL."""
        return footfall_strip(self.column("foot_contact"), self.dt_s, fell=self.fell)


@dataclass(frozen=True, eq=False, kw_only=True)
class SeenPair:
    """Two clips of one command, side by side."""

    left: SeenClip
    right: SeenClip
    command: tuple[float, float, float]
    """Forward m/s, left m/s and yaw rad/s asked for."""

    @property
    def swapped(self) -> SeenPair:
        """The same with the other clip on the left."""
        return SeenPair(left=self.right, right=self.left, command=self.command)


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What a program said, and what it took.

    Raises:
        ValueError: it is no answer that can be given.
    """

    word: Word
    reason: str = ""
    facts: dict[str, Any] = field(default_factory=dict, hash=False)
    """Anything JSON: questions, tokens, what was said in either order."""

    def __post_init__(self) -> None:
        if self.word not in WORDS:
            raise ValueError(f"an answer is one of {', '.join(WORDS)}: {self.word!r}")


ProgramRater = Callable[[SeenPair], Verdict]
"""Looks at a pair. Raises GaitprefError where it cannot be asked at all."""


def seen_pair(dataset: Dataset, pair: Pair, shown_left: Side) -> SeenPair:
    """What there is to see of a pair.

    Raises:
        DatasetError, EpisodeError: an episode is missing or damaged.
    """
    a, b = _seen(dataset, pair.a), _seen(dataset, pair.b)
    left, right = (a, b) if shown_left == "a" else (b, a)
    meta = dataset.entry(pair.a.rollout).meta
    x, y, yaw = map(float, meta.command)
    return SeenPair(left=left, right=right, command=(x, y, yaw))


def _seen(dataset: Dataset, clip: Clip) -> SeenClip:
    episode = dataset.read(clip.rollout)
    rows = np.array(episode.features[clip.rows])
    return SeenClip(
        features=rows,
        dt_s=episode.meta.control_dt_s,
        shot=shot_of(episode, clip),
        fell=bool((rows[:, column("fallen")] > 0).any()),
    )
