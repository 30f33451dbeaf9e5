"""A function of somebody's own, found by the name that its user typed.

Importing a module runs it. So a name comes from a command or from a program, and never
from a data set, a run or any other file that somebody else may have written.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from data.errors import GaitprefError


def imported(what: str, name: str) -> Callable[..., Any]:
    """The callable `package.module:function`; the working directory is searched too.

    Args:
        what: What it is to be, for errors.
        name: As its user typed it.

    Raises:
        GaitprefError: there is none, or its module cannot be imported.
    """
    module_name, _, attribute = name.partition(":")
    here = str(Path.cwd())
    if here not in sys.path:
        # A console script does not search the directory its user stands in.
        sys.path.append(here)
    try:
        found = getattr(importlib.import_module(module_name), attribute)
    except Exception as error:
        raise GaitprefError(
            f"{what} {name} cannot be imported from {here}: "
            f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
        ) from error
    if not callable(found):
        raise GaitprefError(f"{what} {name} is a {type(found).__name__}, not callable")
    return found
