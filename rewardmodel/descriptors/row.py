"""A feature row by name, and what a descriptor is.

Shapes: F columns of a feature row.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from torch import Tensor, float32

from data.features import column

_LIMIT = 1e6
"""Magnitude at which columns are cut: no robot comes near, and the squares of what is
left, summed over twelve joints, stay finite in float32."""


class Row:
    """Named views of feature rows [..., F]: `row["joint_vel"]` is [..., 12]."""

    def __init__(self, features: Tensor) -> None:
        self._features = features.to(float32).clamp(-_LIMIT, _LIMIT)

    def __getitem__(self, name: str) -> Tensor:
        return self._features[..., column(name)]


@dataclass(frozen=True)
class Descriptor:
    """One habit of a gait, as a number per control step."""

    name: str
    unit: str
    meaning: str
    compute: Callable[[Row], Tensor]
    """Its value [...] for rows [..., F]; finite for every finite row."""
    quadratic: bool = False
    """A sum of squares or of products of rates, from 0 up: a gait's moments of effort
    are far above all the rest of it."""
