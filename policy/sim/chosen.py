"""Some of N environments, as the simulator can best be told.

On a CPU a few environments are best listed: nothing is done for the others. On a GPU a
list would first have to be counted, and for that the CPU waits; there a mask goes along
instead, and what is drawn and written is drawn for all and kept for some.

Shapes: N environments, K rows of values that are handed over.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import torch
from torch import Tensor


class Rows(Protocol):
    """Some of N environments."""

    @property
    def count(self) -> int:
        """K: rows that values for them have."""
        ...

    def put(self, target: Tensor, values: Any) -> None:
        """Write `values` [K, ...], or one number, into their rows of `target`
        [N, ...]."""
        ...

    def take(self, source: Tensor) -> Tensor:
        """Rows [K, ...] of `source` [N, ...] that go with values for them."""
        ...


@dataclass(frozen=True, eq=False)
class Listed:
    """Environments by their numbers; K is how many they are."""

    ids: Tensor
    """[K]"""

    @property
    def count(self) -> int:
        """See `Rows.count`."""
        return len(self.ids)

    def put(self, target: Tensor, values: Any) -> None:
        """See `Rows.put`."""
        target[self.ids] = values

    def take(self, source: Tensor) -> Tensor:
        """See `Rows.take`."""
        return source[self.ids]


@dataclass(frozen=True, eq=False)
class Masked:
    """Environments by a mask; K is N, and what is not of them is left alone."""

    mask: Tensor
    """[N]"""

    @property
    def count(self) -> int:
        """See `Rows.count`."""
        return len(self.mask)

    def put(self, target: Tensor, values: Any) -> None:
        """See `Rows.put`."""
        mask = self.mask.view(-1, *[1] * (target.ndim - 1))
        if isinstance(values, Tensor):
            values = values.to(target.dtype)
        target.copy_(torch.where(mask, values, target))

    def take(self, source: Tensor) -> Tensor:
        """See `Rows.take`."""
        return source


def listed(mask: Tensor) -> Listed | None:
    """The environments of a `mask` [N] by their numbers; None where there is none."""
    ids = mask.nonzero().flatten()
    return Listed(ids) if len(ids) else None
