"""Work that falls apart into pieces, and what came of each.

A piece is a function and its arguments, which must be importable and picklable: it runs
in another process, perhaps on another machine, and gives the same there. Whoever has
pieces is handed an `Executor`; only a command chooses which.
"""

from __future__ import annotations

import pickle
import traceback
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, Self

from data.errors import GaitprefError
from policy.parallel.cores import given_cores

from .piece_log import said_into

DEVICES = "CUDA_VISIBLE_DEVICES"
"""Environment variable that names the GPUs a process sees."""


class PieceError(GaitprefError):
    """A piece of work cannot be run, or did not end well."""


def require_share(name: str, gpus: float) -> None:
    """Make sure that so much of a GPU can be had.

    Raises:
        PieceError: it is neither a share nor a number of whole ones.
    """
    if not 0.0 <= gpus <= 1.0 and not (gpus > 1.0 and float(gpus).is_integer()):
        raise PieceError(
            f"{name} asks for {gpus:g} GPUs: give a share between 0 and 1, or a whole "
            "number"
        )


@dataclass(frozen=True, kw_only=True)
class Piece:
    """A part of some work that needs no other part."""

    name: str
    """Tells it from the others."""
    function: Callable[..., Any]
    """Importable by its name."""
    args: tuple[Any, ...] = ()
    """Picklable, as is what the function gives."""
    gpus: float = 0.0
    """Share of a GPU it needs, as 0.5, or a whole number of them; with 0 it sees
    none."""
    cores: int = 1
    """Cores it may keep busy; what comes of it does not depend on that."""
    log: Path | None = None
    """File that what it says is added to; None: it speaks where its process does."""

    def __post_init__(self) -> None:
        require_share(self.name, self.gpus)

    def packed(self) -> bytes:
        """What the process needs that runs it."""
        return pickle.dumps((self.function, self.args, self.log, self.cores))


@dataclass(frozen=True)
class Failure:
    """Why a piece has no value."""

    reason: str
    """One line."""
    trace: str = ""
    """Where the function raised; empty where it was the process that died."""

    @classmethod
    def of(cls, error: BaseException) -> Self:
        """What a function raised."""
        line = " ".join(str(error).split())
        named = line if isinstance(error, GaitprefError) else _named(error, line)
        return cls(named, "".join(traceback.format_exception(error)))


def _named(error: BaseException, line: str) -> str:
    kind = type(error).__name__
    return f"{kind}: {line}" if line else kind


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What came of a piece."""

    piece: Piece
    value: Any = None
    """What its function gave."""
    failure: Failure | None = None
    """Why there is no value."""


class Executor(Protocol):
    """Runs pieces, as many side by side as there is room for."""

    def outcomes(self, pieces: Sequence[Piece]) -> Generator[Outcome]:
        """The outcome of every piece, in the order they end.

        A function that raises is a failure. A process that dies under a piece, as by a
        signal, is none yet: the piece is tried again. Closing the generator, or a
        Ctrl-C, ends what is still running.

        Raises:
            PieceError: a piece asks for more than there is; none was started.
        """
        ...


def attempt(packed: bytes) -> bytes:
    """Run what `Piece.packed` gave, in the process that is meant for it; its value, or
    its failure, for `unpacked`."""
    try:
        function, args, log, share = pickle.loads(packed)
        with said_into(log), given_cores(share):
            return pickle.dumps(function(*args))
    except (Exception, SystemExit) as error:
        return pickle.dumps(Failure.of(error))


def unpacked(piece: Piece, result: bytes) -> Outcome:
    """What `attempt` came to."""
    value = pickle.loads(result)
    if isinstance(value, Failure):
        return Outcome(piece=piece, failure=value)
    return Outcome(piece=piece, value=value)


def died(piece: Piece, how: str, tries: int) -> Outcome:
    """What came of a piece whose process died in every one of `tries` tries."""
    often = "" if tries == 1 else f", in each of {tries} tries"
    return Outcome(piece=piece, failure=Failure(f"its process {how}{often}"))
