"""When a foot stands, for whoever draws footfalls.

Shapes: T steps.
"""

from __future__ import annotations

import numpy as np


def stance_phases(contact: np.ndarray) -> list[tuple[int, int]]:
    """First step and step behind the last of every stretch of `contact` [T]."""
    edges = np.diff(np.concatenate([[0], contact.astype(int), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [(int(a), int(b)) for a, b in zip(starts, ends, strict=True)]
