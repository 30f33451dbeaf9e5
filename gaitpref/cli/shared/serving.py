"""Keeps a server up until somebody stops the command."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from data.errors import GaitprefError


@contextmanager
def stoppable() -> Iterator[threading.Event]:
    """Set the event on Ctrl-C or SIGTERM; from the first line on that says the server
    is up, whoever stops it must find it listening."""
    stopped = threading.Event()

    def stop(number: int, frame: FrameType | None) -> None:
        stopped.set()

    before = {s: signal.signal(s, stop) for s in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stopped
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def wait_until_stopped(stopped: threading.Event) -> None:
    """Return once the event of `stoppable` is set."""
    stopped.wait()


def require_port(port: int) -> None:
    """Refuse a number that is no port.

    Raises:
        GaitprefError: it is none.
    """
    if not 0 <= port <= 65535:
        raise GaitprefError(f"--port must lie in 0 to 65535, got {port}")
