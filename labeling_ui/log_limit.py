"""Keeps the log readable when somebody makes the page complain without end."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from .limits import LOG_LINES_PER_MINUTE

_MINUTE_S = 60.0
_LOGGERS = (
    *(
        f"labeling_ui.{name}"
        for name in (
            "desk", "front_door", "login", "proxy", "relay", "site", "ticker", "visit",
            "worker",
        )
    ),
    "aiohttp.server",
    "aiohttp.web",
    "aiohttp.websocket",
    "asyncio",
)  # fmt: skip


class LogLimit(logging.Filter):
    """Lets so many lines from one place of the code through in a minute."""

    def __init__(self) -> None:
        super().__init__()
        self._lock = threading.Lock()
        self._counts: dict[tuple[str, int], tuple[float, int]] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether the line is written; the first of a minute says what was not."""
        place, now_s = (record.pathname, record.lineno), time.monotonic()
        with self._lock:
            since_s, count = self._counts.get(place, (now_s, 0))
            if now_s - since_s >= _MINUTE_S:
                left_out = count - LOG_LINES_PER_MINUTE
                since_s, count = now_s, 0
                if left_out > 0:
                    text = f"{record.getMessage()} ({left_out} such lines left out)"
                    record.msg, record.args = text, ()
            self._counts[place] = since_s, count + 1
        return count < LOG_LINES_PER_MINUTE


@contextmanager
def limited_log() -> Iterator[None]:
    """Limit what the page and its libraries write."""
    limit = LogLimit()
    for name in _LOGGERS:
        logging.getLogger(name).addFilter(limit)
    try:
        yield
    finally:
        for name in _LOGGERS:
            logging.getLogger(name).removeFilter(limit)
