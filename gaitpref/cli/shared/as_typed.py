"""A command as somebody would type it, from its options."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass
from typing import Any

_SECRET = ("answers",)
"""Options that may hold a password."""


def as_typed(name: str, command: Any) -> str:
    """`gaitpref NAME` with the options that differ from their defaults."""
    return shlex.join(["gaitpref", *name.split(), *_words(command)])


def _words(command: Any) -> Iterator[str]:
    for field in fields(command):
        value = getattr(command, field.name)
        default = field.default
        if default is MISSING and field.default_factory is not MISSING:
            default = field.default_factory()
        if value == default:
            continue
        option = f"--{field.name.replace('_', '-')}"
        if is_dataclass(value):
            yield from _words(value)
        elif field.name in _SECRET:
            yield from (option, "HIDDEN")
        elif value is True:
            yield option
        elif isinstance(value, tuple):
            yield from (option, *map(str, value))
        else:
            yield from (option, str(value))
