"""What a style may cost the walk it is added to."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class TrackingPrice:
    """Where commands are followed worse than the base does, following them is worth
    more, and the style less."""

    slack_m_s: float = 0.02
    """How much worse than the base commands may be followed, mean planar error."""
    sharpness: float = 5.0
    """A share of 1 / `sharpness` beyond the limit, the style counts 1/e of what it does
    within it."""
    price: float = 10.0
    """What an error of 1 m/s costs a second, at most."""
    full_price_at: float = 0.2
    """Excess over the limit, as a share of it, from which on it costs as much."""
