"""Seeds of generators that must not draw the same numbers."""

from __future__ import annotations

import numpy as np


def spawned(seed: int, count: int) -> list[int]:
    """`count` seeds that follow from `seed`: two generators of one seed would draw the
    same numbers, and what should be independent would go together."""
    children = np.random.SeedSequence(seed).spawn(count)
    return [int(child.generate_state(1)[0]) for child in children]
