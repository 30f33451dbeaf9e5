"""One line in the log for a request that is no HTTP; aiohttp writes a traceback."""

from __future__ import annotations

import logging

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

_STRANGERS = (HttpProcessingError, web.RequestPayloadError)
"""What a stranger's bytes raise; everything else is a fault of ours."""


def http_logger() -> logging.Logger:
    """Where the server says what becomes of requests before we see them."""
    logger = logging.getLogger(__name__)
    # Adding the same filter twice adds it once.
    logger.addFilter(_shortened)
    return logger


def _shortened(record: logging.LogRecord) -> bool:
    error = record.exc_info[1] if record.exc_info else None
    if isinstance(error, _STRANGERS):
        record.levelno, record.levelname = logging.WARNING, "WARNING"
        said = f"{record.getMessage()}: {type(error).__name__}"
        record.msg, record.args, record.exc_info = said, (), None
    return True
