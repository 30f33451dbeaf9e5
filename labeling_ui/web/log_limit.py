"""Keeps the log readable when somebody makes the page complain without end."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from aiohttp.http_exceptions import HttpProcessingError, PayloadEncodingError

from labeling_ui.limits.page_limits import LOG_LINES_PER_MINUTE

_MINUTE_S = 60.0
LOGGERS = (
    "labeling_ui.page.frame_thread",
    "labeling_ui.page.page_access",
    "labeling_ui.page.store_thread",
    "labeling_ui.site",
    "labeling_ui.web.front_door",
    "labeling_ui.web.guidelines",
    "labeling_ui.web.login",
    "labeling_ui.web.proxy",
    "labeling_ui.web.visit",
    "labeling_ui.web.websocket_relay",
    "aiohttp.server",
    "aiohttp.web",
    "aiohttp.websocket",
    "asyncio",
)


class LogLimit(logging.Filter):
    """Lets so many lines from one place of the code through in a minute."""

    def __init__(self) -> None:
        super().__init__()
        self._lock = threading.Lock()
        self._counts: dict[tuple[str, int], tuple[float, int]] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether the line is written; the first of a minute says what was not."""
        _shorten(record)
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


def _shorten(record: logging.LogRecord) -> None:
    """A stranger's malformed request is worth a line, and no traceback."""
    error = record.exc_info[1] if record.exc_info else None
    if isinstance(error, HttpProcessingError | PayloadEncodingError):
        name = type(error).__name__
        record.msg, record.args = f"{record.getMessage()}: {name}", ()
        record.exc_info, record.exc_text = None, None
        record.levelno, record.levelname = logging.WARNING, "WARNING"


@contextmanager
def limited_log() -> Iterator[None]:
    """Limit what the page and its libraries write."""
    limit = LogLimit()
    for name in LOGGERS:
        logging.getLogger(name).addFilter(limit)
    try:
        yield
    finally:
        for name in LOGGERS:
            logging.getLogger(name).removeFilter(limit)
