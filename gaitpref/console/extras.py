"""Packages only some commands need, and how to get them."""

from __future__ import annotations

import importlib
from typing import Any

from data.errors import GaitprefError

_OURS = ("data", "gaitpref", "labeling_ui", "policy", "rewardmodel")


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
        raise missing(error, extra) from None


def missing(error: ModuleNotFoundError, extra: str) -> Exception:
    """What to raise where a package is not installed: one line that says which extra
    brings it, but the error itself where a package of ours lacks a module."""
    package, dot, _ = (error.name or "").partition(".")
    if dot and package in _OURS:
        return error
    return MissingExtra(
        f"this needs the package {error.name}, which is not installed: "
        f"pip install -e '.[{extra}]' -c constraints.txt"
    )
