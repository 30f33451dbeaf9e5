"""Processes that do not hear Ctrl-C, which reaches the whole group."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

_STOP_S = 20.0


@contextmanager
def deaf_children() -> Iterator[None]:
    """What is started meanwhile ignores Ctrl-C from its first moment on, also while it
    imports; who started it ends it."""
    # Starting it would unblock the signal again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def beside(
    target: Callable[..., None], *args: Any, name: str
) -> Iterator[tuple[BaseProcess, Connection]]:
    """Run `target(*args, pipe)` in a process that ends with the block, or is ended.

    Gives it, and the other end of its pipe.
    """
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=target, args=(*args, there), name=name)
    with deaf_children():
        process.start()
    there.close()
    try:
        yield process, here
    finally:
        here.close()
        process.join(_STOP_S)
        if process.is_alive():
            process.kill()
            process.join()
