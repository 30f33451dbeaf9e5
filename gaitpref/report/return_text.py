"""A return in words, to the digits that its interval leaves."""

from __future__ import annotations

import math

_MOST_DIGITS = 6


def return_text(mean: float, ci95: float) -> str:
    """`5.58 ± 0.03`, and of a criterion with small scores `-0.0042 ± 0.0003`.

    Args:
        mean: Mean return.
        ci95: Half of its 95 % interval.
    """
    digits = 2
    if 0.0 < ci95 < math.inf:
        digits = min(_MOST_DIGITS, max(digits, -math.floor(math.log10(ci95))))
    return f"{mean:.{digits}f} ± {ci95:.{digits}f}"
