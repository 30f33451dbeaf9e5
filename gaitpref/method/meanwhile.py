"""What people are asked while a policy is trained: nobody waits who has time."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Meanwhile:
    """Questions about the clips there are, from the last answer of a round to the first
    question of the next.

    They come on top of the answers of the run, count in the next fit, and spare the
    next round some of its own.
    """

    batch: int = 4
    """Questions chosen at a time: each choice needs a fit, which slows the training."""
    own_share: float = 0.5
    """Share of a round's questions it asks about its own clips, however many were
    answered before."""

    def __post_init__(self) -> None:
        if self.batch < 1:
            raise ValueError(f"batch must be at least 1, got {self.batch}")
        if not 0.0 <= self.own_share <= 1.0:
            raise ValueError(f"own_share must lie in [0, 1], got {self.own_share}")

    def still_asked(self, count: int, answered: int) -> int:
        """Of `count` questions of a round, those it still asks where so many were
        `answered` before it began."""
        return max(math.ceil(self.own_share * count), count - answered)
