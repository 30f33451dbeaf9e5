"""What a strategy is, and the one that has no opinion.

Shapes: K candidate pairs (two indices into the clips each).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from data.episodes.clips import Clip


class Strategy(Protocol):
    """How much an answer to each candidate would be worth."""

    @property
    def name(self) -> str:
        """Stored with the pair."""
        ...

    def __call__(
        self, clips: Sequence[Clip], candidates: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        """Worth [K] of candidates [K, 2], which index `clips`; more is better.

        A strategy that looks at a whole batch gives what each candidate adds to those
        worth more than it.
        """
        ...


@dataclass(frozen=True)
class Uniform:
    """Any candidate is worth as much as any other."""

    name: str = "uniform"

    def __call__(
        self, clips: Sequence[Clip], candidates: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        return rng.random(len(candidates))
