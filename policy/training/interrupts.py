"""Ctrl-C and SIGTERM, taken where a training can be left."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager

from policy.parallel.ranks import Ranks

_PASSED_ON_S = 2.0
"""Within this time, a signal that comes again is the same one."""


@contextmanager
def interrupts(received: list[int], ranks: Ranks) -> Iterator[None]:
    """Collect the first Ctrl-C or SIGTERM, so that an iteration is never cut in two."""
    first_s = 0.0

    def note(signum: int, frame: object) -> None:
        nonlocal first_s
        # torchrun passes on what the terminal has sent to all of them already.
        again = ranks.size == 1 or time.monotonic() - first_s > _PASSED_ON_S
        if received and again:
            raise KeyboardInterrupt
        if not received:
            first_s = time.monotonic()
            received.append(signum)

    try:
        previous = {s: signal.signal(s, note) for s in (signal.SIGINT, signal.SIGTERM)}
    except ValueError:
        # Not in the main thread: whoever runs us there handles signals.
        yield
        return
    try:
        yield
    finally:
        for signum, handler in previous.items():
            signal.signal(signum, handler)
