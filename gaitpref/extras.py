"""Packages only some commands need, and how to get them."""

from __future__ import annotations

import importlib
from typing import Any

from data.errors import GaitprefError


class MissingExtra(GaitprefError):
    """A package that a command needs is not installed."""


def require(module: str, extra: str) -> Any:
    """The module, or one line that says which extra brings it.

    Raises:
        MissingExtra: it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise MissingExtra(
            f"this needs the package {error.name}, which is not installed: "
            f"pip install -e '.[{extra}]' -c constraints.txt"
        ) from None
