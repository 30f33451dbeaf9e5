"""What a decision may know of the round it is made for."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class RoundContext:
    """A round as its decisions see it; made once a round."""

    number: int
    """Counted from 0; round 0 asks about the first policy, and nothing is trained on a
    learned reward before round 1."""
    rounds: int
    """Number of the last, which trains once more and asks only whether that worked."""
    labels: int
    """Answers in all rounds together."""
    noisy: bool | None = None
    """Whether answers err, as it was decided after the first fit; None before."""

    def __post_init__(self) -> None:
        if not 0 <= self.number <= self.rounds:
            raise ValueError(
                f"number must lie in [0, rounds {self.rounds}], got {self.number}"
            )

    @property
    def is_first(self) -> bool:
        return self.number == 0

    @property
    def is_last(self) -> bool:
        return self.number == self.rounds
