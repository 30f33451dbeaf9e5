"""How work says how far it is, to whoever wants to know."""

from __future__ import annotations

from collections.abc import Callable

Tell = Callable[[int, int], None]
"""Gets how much is done, and of how much."""


def silent(done: int, of: int) -> None:
    """Say nothing."""
