"""One line in the log for a request that is no HTTP; aiohttp writes a traceback."""

from __future__ import annotations

import logging

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

_STRANGERS = (HttpProcessingError, web.RequestPayloadError)
"""What a stranger's bytes raise; everything else is a fault of ours."""


def shorten_http_log() -> None:
    """Have one line written for each of them from now on."""
    # Adding the same filter twice adds it once.
    logging.getLogger("aiohttp.server").addFilter(_shortened)


def _shortened(record: logging.LogRecord) -> bool:
    error = record.exc_info[1] if record.exc_info else None
    if isinstance(error, _STRANGERS):
        record.levelno, record.levelname = logging.WARNING, "WARNING"
        said = f"{record.getMessage()}: {type(error).__name__}"
        record.msg, record.args, record.exc_info = said, (), None
    return True
