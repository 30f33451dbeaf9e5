"""One thread that moves all pages: some fifty times a second, a crowd half as often."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Protocol

from .loop_status import LoopStatus, StatusSource

logger = logging.getLogger(__name__)

PERIOD_S = 1 / 52
"""viser merges what falls into one of its windows: of 52 frames at least 50 arrive."""
CROWD = 16
"""Pages beyond which each is moved every other time: drawing is most of what a page
costs, and answers wait for it."""
_LATE_S = 0.1
_STATUS_S = 1.0


class Ticking(Protocol):
    """Something that moves."""

    def tick(self, elapsed_s: float, status: LoopStatus | None) -> None:
        """Move on by `elapsed_s` of real time."""
        ...

    def attend(self) -> None:
        """Handle what came in; an answer must not wait for the next frame."""
        ...


class Ticker:
    """Calls `tick` of its pages at absolute deadlines, all in one thread."""

    def __init__(self, status: StatusSource) -> None:
        self._status_source = status
        self._pages: dict[int, Ticking] = {}
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._wake = threading.Event()
        self._thread = threading.Thread(target=self._run, name="ticker", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End, and wait for it."""
        self._stop.set()
        self.wake()
        self._thread.join()

    def wake(self) -> None:
        """Let the pages attend to what was posted, before the next frame."""
        self._wake.set()

    def add(self, key: int, page: Ticking) -> None:
        """Move this page too."""
        with self._lock:
            self._pages[key] = page

    def remove(self, key: int) -> None:
        """Leave this page alone, if it is there."""
        with self._lock:
            self._pages.pop(key, None)

    @property
    def period_s(self) -> float:
        """Time from one frame to the next."""
        return PERIOD_S if len(self._pages) <= CROWD else 2 * PERIOD_S

    def _run(self) -> None:
        last = due = time.monotonic()
        status, status_due = None, last
        while not self._stop.is_set():
            due += self.period_s
            if due < time.monotonic() - _LATE_S:
                # The machine was asleep or overloaded: catching up would only jerk.
                due = time.monotonic()
            self._attend_until(due)
            now = time.monotonic()
            if now >= status_due:
                status, status_due = self._read_status(), now + _STATUS_S
            self._each(partial(self._tick, elapsed_s=now - last, status=status))
            last = now

    def _tick(
        self, page: Ticking, *, elapsed_s: float, status: LoopStatus | None
    ) -> None:
        page.tick(elapsed_s, status)
        self._attend()

    def _attend(self) -> None:
        if self._wake.is_set():
            self._wake.clear()
            self._each(lambda page: page.attend())

    def _attend_until(self, due: float) -> None:
        while not self._stop.is_set() and (delay := due - time.monotonic()) > 0:
            self._wake.wait(delay)
            self._attend()

    def _each(self, do: Callable[[Ticking], None]) -> None:
        with self._lock:
            pages = tuple(self._pages.items())
        for key, page in pages:
            try:
                do(page)
            except Exception:
                # One broken page must not stop the others.
                logger.exception("a page failed and is no longer moved")
                self.remove(key)

    def _read_status(self) -> LoopStatus | None:
        try:
            return self._status_source()
        except Exception:
            logger.exception("the status cannot be read")
            return None
