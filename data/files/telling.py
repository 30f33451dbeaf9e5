"""How work says how far it is, to whoever wants to know."""

from __future__ import annotations

from collections.abc import Callable

Tell = Callable[[int, int], None]
"""Gets how much is done, and of how much."""


def one_of(parts: int, number: int, tell: Tell) -> Tell:
    """Tells of the part `number` of as many equal parts, as of the whole."""
    return lambda done, of: tell(number * of + done, parts * of)


def silent(done: int, of: int) -> None:
    """Say nothing."""
