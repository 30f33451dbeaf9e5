"""How a robot from scratch that stands still is got going.

Answers about robots that tumble make standing still look best, and one that stands
shows nobody what walking would be like: round after round nothing new is asked about.
"""

from __future__ import annotations

from dataclasses import dataclass

from .context import RoundContext


@dataclass(frozen=True, kw_only=True)
class Optimism:
    """A training follows those members of the reward who think least of standing."""

    deviations: float = 2.0
    """Over the ensemble, by which the reward is moved towards them."""
    still: float = 0.2
    """Share of the speed it is told below which a robot stands still."""

    def looks(self, context: RoundContext) -> bool:
        """Whether the policy a round begins from is looked at: it has been trained on a
        learned reward, and something is learned from what the next shows."""
        return context.number > 1 and not context.is_last
