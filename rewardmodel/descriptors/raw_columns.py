"""The columns of a feature row as they are, for networks that are to find habits."""

from __future__ import annotations

from torch import Tensor

from data.features import FEATURES

from .row import Descriptor, Row


def _column(name: str, unit: str, meaning: str, index: int) -> Descriptor:
    def compute(row: Row) -> Tensor:
        return row[name][..., index]

    return Descriptor(f"{name}[{index}]", unit, meaning, compute, signed=True)


RAW = tuple(
    _column(feature.name, feature.unit, feature.meaning, index)
    for feature in FEATURES
    # A step that falls is never looked at, so this is 0 in all others.
    if feature.name != "fallen"
    for index in range(feature.width)
)
