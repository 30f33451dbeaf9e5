"""What is wrong with the weights in a file; knows tensors only by their shapes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Protocol

import numpy as np

_MOST_TOLD = 4


class _Shaped(Protocol):
    @property
    def shape(self) -> Any: ...


def not_finite(state: Mapping[str, Any]) -> str:
    """Which arrays of a state, dictionaries in it included, hold NaN or infinity.

    Returns:
        Names and counts in one line; empty where every number is finite.
    """
    found = [
        f"{name} ({bad:,} of {array.size:,} numbers)"
        for name, array in _arrays(state, "")
        if (bad := int((~np.isfinite(array)).sum()))
    ]
    return _some(found)


def misfits(found: Mapping[str, _Shaped], wanted: Mapping[str, _Shaped]) -> str:
    """How the arrays of a file differ from those of the network it is for.

    Returns:
        Names and shapes in one line; empty where they fit.
    """
    told = [
        f"{name} is {_size(found[name])} in the file and {_size(array)} in the network"
        for name, array in wanted.items()
        if name in found and tuple(found[name].shape) != tuple(array.shape)
    ]
    told += [f"{name} is missing" for name in wanted if name not in found]
    told += [f"{name} is unknown" for name in found if name not in wanted]
    return _some(told)


def _arrays(state: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, np.ndarray]]:
    for key, value in state.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            yield from _arrays(value, f"{name}.")
        elif hasattr(value, "shape"):
            # NumPy does not reach into a GPU.
            array = np.asarray(value.cpu() if hasattr(value, "cpu") else value)
            if array.dtype.kind == "f":
                yield name, array


def _size(array: _Shaped) -> str:
    return " x ".join(map(str, array.shape)) or "one number"


def _some(told: list[str]) -> str:
    more = len(told) - _MOST_TOLD
    return "; ".join(told[:_MOST_TOLD]) + (f"; and {more} more" if more > 0 else "")
