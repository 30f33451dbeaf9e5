"""Pieces in processes of this machine, one process a piece.

Each is copied from one that has only imported what pieces need, which takes seconds and
is done once. So a piece has the state, the memory and the GPU it would have alone.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from multiprocessing import connection
from multiprocessing.process import BaseProcess
from typing import Self

from gaitpref.console.deaf_children import deaf_children
from policy.parallel.cores import cores

from .gpu_slots import Place, Slots, require_gpus, visible_gpus
from .pieces import DEVICES, Outcome, Piece, attempt, died, unpacked

# Copies of this process would inherit torch's threads in an unknown state.
_COPIES = multiprocessing.get_context("forkserver")
_STOP_S = 15.0
"""How long a process may take to save what it was at."""
_LEAVE_S = 5.0
"""How long it may take to go once it has given its value."""


@dataclass(frozen=True, kw_only=True)
class Processes:
    """An `Executor` of processes."""

    workers: int = field(default_factory=cores)
    """Pieces side by side."""
    gpus: tuple[str, ...] | None = None
    """GPUs by their names in CUDA_VISIBLE_DEVICES; None: those this process sees."""
    retries: int = 2
    """Times a piece is tried again whose process died."""

    def outcomes(self, pieces: Sequence[Piece]) -> Generator[Outcome]:
        """The outcome of every piece, in the order they end.

        Raises:
            PieceError: a piece asks for more GPUs than there are.
        """
        gpus = self._gpus(pieces)
        require_gpus(pieces, len(gpus), "this machine")
        slots = Slots(self.workers, gpus)
        # Who started a process of this kind before has chosen for good.
        _COPIES.set_forkserver_preload(sorted({p.function.__module__ for p in pieces}))
        waiting = [_Job(piece, piece.packed()) for piece in pieces]
        running: list[_Child] = []
        try:
            while waiting or running:
                for job, place in _fitting(waiting, slots):
                    waiting.remove(job)
                    running.append(_Child.start(job, place))
                for child in _ended(running):
                    running.remove(child)
                    slots.give_back(child.place)
                    job, result = child.job, child.result()
                    job.tries += 1
                    if result is not None:
                        yield unpacked(job.piece, result)
                    elif job.tries <= self.retries:
                        waiting.insert(0, job)
                    else:
                        yield died(job.piece, child.end, job.tries)
        finally:
            _stop(running)

    def _gpus(self, pieces: Sequence[Piece]) -> tuple[str, ...]:
        if self.gpus is None and any(piece.gpus for piece in pieces):
            return visible_gpus()
        return self.gpus or ()


@dataclass(eq=False)
class _Job:
    piece: Piece
    packed: bytes
    tries: int = 0


def _fitting(waiting: Sequence[_Job], slots: Slots) -> list[tuple[_Job, Place]]:
    """Jobs that a place was taken for; one that waits for a GPU is not overtaken by
    another that needs one."""
    found, gpu_awaited = [], False
    for job in waiting:
        if job.piece.gpus and gpu_awaited:
            continue
        if place := slots.take(job.piece.gpus):
            found.append((job, place))
        else:
            gpu_awaited |= job.piece.gpus > 0.0
    return found


@dataclass(eq=False)
class _Child:
    """A process at work on a piece."""

    job: _Job
    place: Place
    process: BaseProcess
    pipe: connection.Connection

    @classmethod
    def start(cls, job: _Job, place: Place) -> Self:
        here, there = _COPIES.Pipe(duplex=False)
        environment = {**os.environ, DEVICES: ",".join(place.gpus)}
        process = _COPIES.Process(
            target=_work,
            args=(there, job.packed, environment),
            name=job.piece.name,
        )
        with deaf_children():
            process.start()
        there.close()
        return cls(job, place, process, here)

    def result(self) -> bytes | None:
        """What `attempt` gave; None where the process died before."""
        try:
            result = self.pipe.recv_bytes() if self.pipe.poll() else None
        except EOFError:
            result = None
        self.pipe.close()
        self.process.join(_LEAVE_S)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()
        return result

    @property
    def end(self) -> str:
        """How the process died."""
        code = self.process.exitcode or 0
        if code < 0:
            return f"was killed by {signal.Signals(-code).name}"
        return f"ended with exit code {code}"


def _ended(running: Sequence[_Child]) -> list[_Child]:
    """Wait until some have a result or are dead."""
    pipes = [child.pipe for child in running]
    ready = connection.wait([*pipes, *(child.process.sentinel for child in running)])
    return [c for c in running if c.pipe in ready or c.process.sentinel in ready]


def _stop(running: Sequence[_Child]) -> None:
    for child in running:
        child.process.terminate()
    end_s = time.monotonic() + _STOP_S
    for child in running:
        child.process.join(max(0.0, end_s - time.monotonic()))
        child.process.kill()
        child.process.join()
        child.pipe.close()


def _work(
    pipe: connection.Connection, packed: bytes, environment: dict[str, str]
) -> None:
    """Run a piece, in its process."""
    # It hears no Ctrl-C: who started this says when it ends.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    # Before anything is unpacked that could look for GPUs. What it is copied from has
    # the environment of its own beginning.
    os.environ.clear()
    os.environ.update(environment)
    try:
        pipe.send_bytes(attempt(packed))
    except (KeyboardInterrupt, BrokenPipeError):
        os._exit(1)


def _end_with_parent() -> None:
    """A command that is killed leaves nothing running."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
