"""Keeps a server up until somebody stops the command."""

from __future__ import annotations

import signal
import threading
from types import FrameType

from data.errors import GaitprefError


def wait_until_stopped() -> None:
    """Return on Ctrl-C or SIGTERM."""
    stopped = threading.Event()

    def stop(number: int, frame: FrameType | None) -> None:
        stopped.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    stopped.wait()


def require_port(port: int) -> None:
    """Refuse a number that is no port.

    Raises:
        GaitprefError: it is none.
    """
    if not 0 <= port <= 65535:
        raise GaitprefError(f"--port must lie in 0 to 65535, got {port}")
