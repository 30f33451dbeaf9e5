"""What pieces gave, in their order, for who waits for all of them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from typing import Any

from gaitpref.executor.pieces import Executor, Piece, PieceError


def in_order(executor: Executor, pieces: Sequence[Piece]) -> list[Any]:
    """The values of all pieces, in their order.

    Raises:
        PieceError: one failed; the others that still ran are ended.
    """
    values: dict[int, Any] = {}
    places = {id(piece): place for place, piece in enumerate(pieces)}
    with closing(executor.outcomes(pieces)) as outcomes:
        for outcome in outcomes:
            if outcome.failure is not None:
                raise PieceError(f"{outcome.piece.name}: {outcome.failure.reason}")
            values[places[id(outcome.piece)]] = outcome.value
    return [values[place] for place in range(len(pieces))]
