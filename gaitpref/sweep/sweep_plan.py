"""What a sweep varies, and the cells that come of it."""

from __future__ import annotations

import hashlib
import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from data.errors import GaitprefError

CRITERION, VARIANT, SEED = "criterion", "variant", "seed"
USUAL = {CRITERION: ("high_step",), SEED: (0, 1, 2)}
"""What is varied where nothing is said of it."""
MOST_CELLS = 10_000
_UNUSUAL = re.compile(r"[^\w.=@+-]+", re.ASCII)
_LONGEST_NAME = 120


class SweepError(GaitprefError):
    """A sweep cannot be run as it is asked for."""


@dataclass(frozen=True, kw_only=True)
class PlannedCell:
    """One loop of a sweep."""

    name: str
    """Of its directory and its log; tells all that is varied."""
    settings: Mapping[str, Any]
    """What is varied, as it is here, the seed last."""
    changes: Mapping[str, Any]
    """All that is another than in a loop without options: options of `gaitpref loop`
    by their names, and settings of its configuration by their dotted paths."""


@dataclass(frozen=True, kw_only=True)
class SweepPlan:
    """Everything varied, each value with each of the others."""

    axes: Mapping[str, tuple[Any, ...]]
    """Values of each option or setting that is varied, of the seed too."""
    variants: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Changes that go together, by a name that is varied with the rest; nothing: there
    are none."""
    fixed: Mapping[str, Any] = field(default_factory=dict)
    """Changes that all cells share."""

    def __post_init__(self) -> None:
        for name, values in self.axes.items():
            if not values:
                raise SweepError(f"{name} has no value: give at least one")
            told = [value_text(value) for value in values]
            if twice := {text for text in told if told.count(text) > 1}:
                raise SweepError(f"{name} is given {min(twice)} twice")
        self._require_one_place()
        count = len(self.variants) or 1
        for values in (USUAL | dict(self.axes)).values():
            count *= len(values)
        if count > MOST_CELLS:
            raise SweepError(
                f"that makes {count:,} loops, and {MOST_CELLS:,} are the most: vary "
                "less at once"
            )

    def _require_one_place(self) -> None:
        varied = [*USUAL, *self.axes, VARIANT]
        of_variants = [name for own in self.variants.values() for name in own]
        for name in (*self.fixed, *of_variants):
            if name in varied or (name in self.fixed and name in of_variants):
                raise SweepError(
                    f"{name} is set in two places: vary it, let variants say it, or "
                    "set it for all"
                )

    def cells(self) -> list[PlannedCell]:
        """All cells, first seeds first, so that every row soon has a figure."""
        given = USUAL | dict(self.axes)
        variants = {VARIANT: tuple(self.variants)} if self.variants else {}
        # The seed is what means are over: it stands last.
        order = {CRITERION: given.pop(CRITERION)} | variants | given
        order[SEED] = order.pop(SEED)
        found = [
            self._cell(dict(zip(order, values, strict=True)))
            for values in itertools.product(*order.values())
        ]
        return sorted(found, key=lambda cell: order[SEED].index(cell.settings[SEED]))

    def _cell(self, settings: dict[str, Any]) -> PlannedCell:
        own = {n: v for n, v in settings.items() if n != VARIANT}
        variant = self.variants[settings[VARIANT]] if VARIANT in settings else {}
        return PlannedCell(
            name=_name_of(settings),
            settings=settings,
            changes={**self.fixed, **own, **variant},
        )


def value_text(value: Any) -> str:
    """A value on one line, as it is shown and told from others."""
    if isinstance(value, Mapping):
        inner = ", ".join(f"{key}: {value_text(v)}" for key, v in value.items())
        return f"{{{inner}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(value_text, value))}]"
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    return str(value)


def _name_of(settings: Mapping[str, Any]) -> str:
    parts = [
        text
        if name in (CRITERION, VARIANT)
        else f"{name}{text}"
        if name == SEED
        else f"{name}={text}"
        for name, text in ((n, value_text(v)) for n, v in settings.items())
    ]
    whole = "-".join(parts)
    usual = _UNUSUAL.sub("_", whole).lstrip(".-")
    if usual == whole and len(whole) <= _LONGEST_NAME:
        return whole
    # What a file name cannot hold still tells two cells apart.
    return f"{usual[:_LONGEST_NAME]}-{hashlib.sha256(whole.encode()).hexdigest()[:8]}"
