"""The smallest and largest value of an option, told where the option is declared."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, is_dataclass
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from data.errors import GaitprefError


@dataclass(frozen=True)
class AtLeast:
    """Marks the type of an option: no command can work with less."""

    smallest: int


@dataclass(frozen=True)
class AtMost:
    """Marks the type of an option: more would exhaust a machine."""

    largest: int


Count = Annotated[int, AtLeast(1)]
CountOrZero = Annotated[int, AtLeast(0)]
Seed = Annotated[int, AtLeast(0)]
Width = Annotated[int, AtLeast(1), AtMost(4096)]
"""Of a layer; two critics of two layers of 4096 no training could go on from."""


def require_bounds(command: Any) -> None:
    """Refuse numbers no command can work with, in records of options too.

    Raises:
        GaitprefError: an option is below its smallest value, or above its largest.
    """
    for name, hint in get_type_hints(type(command), include_extras=True).items():
        value = getattr(command, name)
        if is_dataclass(value):
            require_bounds(value)
            continue
        for bound in _bounds(hint):
            for number in value if isinstance(value, tuple) else (value,):
                # Also what is no number at all, as NaN.
                if number is not None and (told := _beyond(bound, number)):
                    option = name.replace("_", "-")
                    raise GaitprefError(f"--{option} must be {told}, got {number}")


def _beyond(bound: AtLeast | AtMost, number: float) -> str:
    """What `number` must be and is not, or nothing."""
    match bound:
        case AtLeast(smallest):
            return "" if number >= smallest else f"at least {smallest}"
        case AtMost(largest):
            return "" if number <= largest else f"at most {largest}"


def _bounds(hint: Any) -> Iterator[AtLeast | AtMost]:
    """The marks in a type, those of its alternatives included."""
    if get_origin(hint) is Annotated:
        yield from (
            mark for mark in hint.__metadata__ if isinstance(mark, AtLeast | AtMost)
        )
    for part in get_args(hint):
        yield from _bounds(part)
