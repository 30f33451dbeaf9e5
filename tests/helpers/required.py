"""What a machine may lack, so that tests skip, and CI may not, so that they fail."""

from __future__ import annotations

import importlib
import os
import warnings
from typing import Any, NoReturn

import pytest

EXTRAS = {"RAY": "scale", "WARP": "gpu", "FSSPEC": "remote"}
"""Of packages; programs and servers are asked for by whoever starts them."""


def lacking(kind: str, what: str) -> NoReturn:
    """Skip for `what` is missing, or fail where GAITPREF_REQUIRE_<kind> is set."""
    variable = f"GAITPREF_REQUIRE_{kind}"
    if os.environ.get(variable):
        pytest.fail(f"{variable} is set, but {what}", pytrace=False)
    pytest.skip(what, allow_module_level=True)


def needed(module: str, kind: str) -> Any:
    """The module of a package of that kind, unless it is lacking."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return importlib.import_module(module)
    except ImportError as error:
        lacking(kind, f"{error} (extra `{EXTRAS[kind]}`)")
