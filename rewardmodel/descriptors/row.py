"""A feature row by name, and what a habit and a descriptor are.

Shapes: F columns of a feature row.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from torch import Tensor, float32

from data.answers.answer_records import Aspect
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
class Habit:
    """One habit of a gait: what it is called, and all that is believed of it."""

    name: str
    unit: str
    meaning: str
    quadratic: bool = field(default=False, kw_only=True)
    """A sum of squares or of products of rates, from 0 up: a gait's moments of effort
    are far above all the rest of it."""
    signed: bool = field(default=False, kw_only=True)
    """Whether the habit can be below 0."""
    swings: bool = field(default=False, kw_only=True)
    """Whether it goes to and fro with every step: nobody wishes it neither high nor
    low."""
    group: str = field(default="other", kw_only=True)
    """What it is explained together with: correlated habits share a reward by chance,
    their group does not."""
    aspect: Aspect | None = field(default=None, kw_only=True)
    """The reason an answer can give that means it; None of what a robot is told."""
    concept: str | None = field(default=None, kw_only=True)
    """What people have one word for, of this habit and others; each concept is as
    probable a wish as the others, and so is each of its habits. None: no wish."""


@dataclass(frozen=True)
class Descriptor(Habit):
    """A habit that one feature row tells, as a number per control step."""

    compute: Callable[[Row], Tensor]
    """Value [...] for rows [..., F]; finite for every finite row."""
