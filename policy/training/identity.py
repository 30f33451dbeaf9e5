"""What a thing is, told by its content: equal contents tell the same, on any machine.

A training goes on only under the reward it began with. A name cannot tell that: the
directory behind it may have been fitted again, a function edited.
"""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor, nn

_DIGITS = 6
"""A figure that was measured differs in its last bits from machine to machine."""


def content_of(value: Any) -> Any:
    """Plain values that tell `value` by its content: its class, numbers, and source.

    Fields of a dataclass that do not count when two are compared do not count here.
    """
    match value:
        case None | bool() | int() | str():
            return value
        case float():
            return float(f"{value:.{_DIGITS}g}")
        case Path():
            return str(value)
        case Tensor():
            return _hashed(value.detach().cpu().contiguous().numpy())
        case np.ndarray():
            return _hashed(value)
        case nn.Module():
            parts = [type(part).__qualname__ for part in value.modules()]
            return {
                "parts": _of_text(" ".join(parts)),
                **content_of(value.state_dict()),
            }
        case Mapping():
            return {str(key): content_of(entry) for key, entry in value.items()}
        case list() | tuple() | set() | frozenset():
            entries = sorted(value) if isinstance(value, set | frozenset) else value
            return [content_of(entry) for entry in entries]
        case partial():
            return content_of([value.func, value.args, value.keywords])
    if is_dataclass(value) and not isinstance(value, type):
        told = {
            f.name: content_of(getattr(value, f.name))
            for f in fields(value)
            if f.compare
        }
        return {"class": type(value).__qualname__, **told}
    if inspect.isroutine(value):
        return _of_function(value)
    told = content_of(vars(value)) if hasattr(value, "__dict__") else {}
    return {"class": type(value).__qualname__, "source": _source(type(value)), **told}


def _of_function(function: Any) -> dict[str, Any]:
    """Source of `function`, and what it holds on to from where it was made."""
    held = [cell.cell_contents for cell in getattr(function, "__closure__", None) or ()]
    if inspect.ismethod(function):
        held.append(function.__self__)
    named = f"{function.__module__}:{function.__qualname__}"
    return {"function": named, "source": _source(function), "held": content_of(held)}


def _source(thing: Any) -> str:
    try:
        return _of_text(inspect.getsource(thing))
    except (OSError, TypeError):
        # Typed into an interpreter, or built in: its name has to do.
        return ""


def _of_text(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _hashed(array: np.ndarray) -> str:
    shape = " x ".join(map(str, array.shape))
    digest = hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()
    return f"{array.dtype} {shape} {digest[:16]}"


def differences(old: Any, new: Any, name: str = "") -> list[str]:
    """Where two contents differ: `NAME OLD -> NEW` each, names joined by dots.

    A function that only moved to another module is the same.
    """
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        old, new = dict(enumerate(old)), dict(enumerate(new))
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        return [
            told
            for key in sorted(old.keys() | new.keys())
            for told in differences(
                old.get(key, "nothing"),
                new.get(key, "nothing"),
                f"{name}.{key}" if name else str(key),
            )
        ]
    same = old == new or (
        name.rpartition(".")[2] == "function"
        and f"{old}".rpartition(":")[2] == f"{new}".rpartition(":")[2]
    )
    return [] if same else [f"{name} {_short(old)} -> {_short(new)}"]


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
