"""What the loop is doing, as the page shows it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class LoopStatus:
    """One line and a bar."""

    text: str
    """Such as "round 3 of 6: training"."""
    progress: float | None = None
    """In [0, 1]; None shows no bar."""

    def __post_init__(self) -> None:
        if self.progress is not None and not 0.0 <= self.progress <= 1.0:
            raise ValueError(f"progress must lie in [0, 1], got {self.progress}")


StatusSource = Callable[[], LoopStatus | None]
"""Asked about once a second, from one thread; None shows nothing."""


def no_status() -> LoopStatus | None:
    """Tell that the page belongs to no loop."""
    return None
