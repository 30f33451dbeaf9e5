"""Places for pieces on one machine: its cores, and shares of its GPUs."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

from .pieces import DEVICES, Piece, PieceError

_ROUNDING = 1e-9
"""Three thirds are a whole."""


@dataclass(frozen=True, kw_only=True)
class Place:
    """What a running piece holds."""

    share: float
    """Of each of the GPUs."""
    gpus: tuple[str, ...]


class Slots:
    """Which places are free."""

    def __init__(self, workers: int, gpus: Sequence[str]) -> None:
        self._workers = workers
        self._free = dict.fromkeys(gpus, 1.0)

    def take(self, gpus: float) -> Place | None:
        """A place with so much of a GPU, or with so many; None while there is none.

        A share is taken where it leaves least, so that whole GPUs stay whole.
        """
        if not self._workers:
            return None
        share, count = (gpus, 1) if 0.0 < gpus < 1.0 else (1.0, int(gpus))
        fitting = [g for g, free in self._free.items() if free >= share - _ROUNDING]
        if len(fitting) < count:
            return None
        taken = tuple(sorted(fitting, key=self._free.__getitem__)[:count])
        self._workers -= 1
        for gpu in taken:
            self._free[gpu] -= share
        return Place(share=share, gpus=taken)

    def give_back(self, place: Place) -> None:
        """Free a place that was taken."""
        self._workers += 1
        for gpu in place.gpus:
            self._free[gpu] += place.share


def visible_gpus() -> tuple[str, ...]:
    """Names, as of CUDA_VISIBLE_DEVICES, of the GPUs this process may use."""
    told = os.environ.get(DEVICES)
    if told is not None:
        return tuple(name for name in told.split(",") if name)
    # Only who asks for a GPU waits for this.
    import torch

    return tuple(str(number) for number in range(torch.cuda.device_count()))


def require_gpus(pieces: Sequence[Piece], there: float, where: str) -> None:
    """Make sure that no piece waits for GPUs that will never be there.

    Raises:
        PieceError: one does.
    """
    for piece in pieces:
        if piece.gpus > there:
            raise PieceError(
                f"{piece.name} asks for {piece.gpus:g} of a GPU, and {where} has "
                f"{there:g}: ask for less, or run it where there is one"
            )
