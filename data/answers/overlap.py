"""How many people answer a pair."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Overlap:
    """Which pairs more than one person answers; equal on all machines."""

    share: float = 0.2
    """Share of the pairs, in [0, 1]."""
    raters: int = 2
    """People who answer each of these pairs."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.share <= 1.0 or self.raters < 1:
            raise ValueError(
                "an overlap needs a share in [0, 1] and at least one rater, got "
                f"{self.share} and {self.raters}"
            )

    @property
    def below(self) -> str:
        """Pairs whose id, a hash, sorts below this text overlap."""
        return f"{round(self.share * 2**32):08x}" if self.share < 1.0 else "g"

    def takes(self, pair_id: str) -> bool:
        """Whether several people answer this pair."""
        return pair_id < self.below
