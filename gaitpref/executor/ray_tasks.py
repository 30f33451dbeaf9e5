"""Pieces as tasks of Ray, on the machines of a cluster.

The working directory and the files of a piece must be where every machine reaches them
under one path.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Collection, Generator, Sequence
from dataclasses import dataclass
from typing import Any

from gaitpref.console.extras import require
from policy.parallel.cores import cores
from policy.parallel.ray_connection import connected

from .gpu_slots import require_gpus
from .pieces import DEVICES, Outcome, Piece, attempt, died, unpacked

_STOP_S = 15.0
"""How long a task may take to save what it was at."""


@dataclass(frozen=True, kw_only=True)
class RayTasks:
    """An `Executor` of Ray tasks."""

    address: str
    """As of `connected`."""
    retries: int = 2
    """Times a piece is tried again whose process or machine died."""

    def outcomes(self, pieces: Sequence[Piece]) -> Generator[Outcome]:
        """The outcome of every piece, in the order they end.

        Raises:
            MissingExtra: Ray is not installed.
            RayError: none can be used.
            PieceError: a piece asks for more GPUs than the cluster has.
        """
        if not pieces:
            return
        packed = [piece.packed() for piece in pieces]
        require("ray", "scale")
        with connected(self.address, cores=cores()) as ray:
            there = ray.cluster_resources().get("GPU", 0.0)
            require_gpus(pieces, there, f"the cluster at {self.address}")
            task, here = ray.remote(_in_place), os.getcwd()
            left = {
                task.options(
                    name=piece.name,
                    num_cpus=piece.cores,
                    num_gpus=piece.gpus,
                    max_retries=self.retries,
                ).remote(work, here, piece.gpus): piece
                for piece, work in zip(pieces, packed, strict=True)
            }
            try:
                while left:
                    (ready,), _ = ray.wait(list(left), num_returns=1)
                    piece = left.pop(ready)
                    try:
                        yield unpacked(piece, ray.get(ready))
                    except ray.exceptions.RayError as error:
                        yield died(piece, _end(error), self.retries + 1)
            finally:
                _stop(ray, left)


def _in_place(packed: bytes, directory: str, gpus: float) -> bytes:
    """Run a piece as a process of this machine would, in a worker of Ray's."""
    if not gpus:
        # Ray leaves them in sight.
        os.environ[DEVICES] = ""
    with contextlib.chdir(directory):
        return attempt(packed)


def _end(error: Exception) -> str:
    line = " ".join(str(error).split())
    return f"died ({type(error).__name__}: {line[:200]})"


def _stop(ray: Any, left: Collection[Any]) -> None:
    """Let what runs save, then end it."""
    if not left:
        return
    for task in left:
        ray.cancel(task)
    _, late = ray.wait(list(left), num_returns=len(left), timeout=_STOP_S)
    for task in late:
        ray.cancel(task, force=True)
