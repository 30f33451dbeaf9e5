"""How two robots of a team begin, and what a formation is worth by hand."""

from __future__ import annotations

from dataclasses import dataclass, field

from data.files.plain import ADDED_LATER


@dataclass(frozen=True, kw_only=True)
class TeamCfg:
    """Two robots side by side in one world, told the same."""

    gap_m: float = 0.8
    """Distance between both, side by side, that a formation keeps."""
    start_across_m: float = 0.15
    """Noise of where each begins, across the way; uniform, plus or minus."""
    start_along_m: float = 0.3
    """The same along the way."""
    start_rad: float = 0.2
    """Noise of the heading that each begins with."""
    formation: float = 1.0
    """Weight of the hand-written formation per robot and second: exp(-e^2 / 0.1), e in
    m how far the other is from beside it at that distance."""
    heading: float = 0.5
    """Weight of going the same way: the cosine of the angle between both."""
    told_apart: bool = field(default=False, metadata=ADDED_LATER)
    """The last number each sees is 0 for the first robot and 1 for the second."""

    def __post_init__(self) -> None:
        if not self.gap_m - 2 * self.start_across_m > 0.4:
            raise ValueError(
                f"robots that begin {self.gap_m} m apart, give or take "
                f"{self.start_across_m} m each, might begin inside each other: leave "
                "more than 0.4 m"
            )
