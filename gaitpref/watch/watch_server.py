"""Serves the live page on loopback: four files, one JSON, and the run's report."""

from __future__ import annotations

import asyncio
import json
import logging
import math
import threading
import time
from collections.abc import Awaitable, Callable
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aiohttp import web

from data.errors import GaitprefError
from labeling_ui.web.checks import host_name, is_loopback
from labeling_ui.web.responses import add_security_headers, refused

if TYPE_CHECKING:
    from .run_state import RunReader

logger = logging.getLogger(__name__)
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]
HOST = "127.0.0.1"
_FRESH_S = 1.0
"""Several pages share what was read so long ago at most."""
_REPORT_BYTES = 64 * 2**20
_FILES = {
    "/": ("watch.html", "text/html"),
    "/watch.css": ("watch.css", "text/css"),
    "/watch.js": ("watch.js", "text/javascript"),
}
_OWN_POLICY = (
    "default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'; "
    "script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:"
)
_REPORT_POLICY = (
    "default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'; "
    "style-src 'unsafe-inline'; img-src data:"
)
"""The report is one file with everything in it, and has no script."""


class WatchServer:
    """The page of one run."""

    def __init__(self, run: Path, port: int) -> None:
        self._run, self._port = run, port
        self._reader: RunReader | None = None
        self._mutex = threading.Lock()
        self._read: tuple[float, bytes] | None = None

    @property
    def url(self) -> str:
        """Where the page is; the port is known while `serve` runs."""
        return f"http://{HOST}:{self._port}/"

    async def serve(self, ready: Callable[[], None], wait: Callable[[], None]) -> None:
        """Serve until `wait` returns; `ready` is called once the page is there.

        Raises:
            GaitprefError: the port cannot be opened.
        """
        app = web.Application(middlewares=[_guard], client_max_size=1024)
        for path in _FILES:
            app.router.add_get(path, self._file)
        app.router.add_get("/state.json", self._state)
        app.router.add_get("/report", self._report)
        app.on_response_prepare.append(add_security_headers)
        runner = web.AppRunner(app, access_log=None, shutdown_timeout=1.0)
        await runner.setup()
        try:
            site = web.TCPSite(runner, HOST, self._port)
            try:
                await site.start()
            except OSError as error:
                raise GaitprefError(
                    f"port {self._port} on {HOST} cannot be opened "
                    f"({error.strerror or error}); stop what uses it, or choose "
                    "another with --port"
                ) from None
            self._port = runner.addresses[0][1]
            ready()
            await asyncio.to_thread(wait)
        finally:
            await runner.cleanup()

    async def _file(self, request: web.Request) -> web.Response:
        name, kind = _FILES[request.path]
        content = resources.files("gaitpref.watch").joinpath("browser", name)
        return _answer(content.read_text("utf-8").encode(), kind, _OWN_POLICY)

    async def _state(self, request: web.Request) -> web.Response:
        content = await asyncio.to_thread(self._newest)
        return _answer(content, "application/json", _OWN_POLICY)

    async def _report(self, request: web.Request) -> web.Response:
        try:
            content = await asyncio.to_thread(self._written)
        except (GaitprefError, OSError):
            return refused(404, "The run has no report yet.")
        return _answer(content, "text/html", _REPORT_POLICY)

    def _written(self) -> bytes:
        with self._mutex:
            return self._opened().report(_REPORT_BYTES)

    def _opened(self) -> RunReader:
        if self._reader is None:
            # It imports torch, for which no page has to wait.
            from .run_state import RunReader

            self._reader = RunReader(self._run)
        return self._reader

    def _newest(self) -> bytes:
        with self._mutex:
            now_s = time.monotonic()
            if self._read is None or now_s - self._read[0] > _FRESH_S:
                text = json.dumps(_spelled(self._opened().read()), allow_nan=False)
                self._read = (time.monotonic(), text.encode())
            return self._read[1]


@web.middleware
async def _guard(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Answer pages of this machine alone: a foreign name may lead here too."""
    name = host_name(request.headers.get("Host", ""))
    if name is None or not is_loopback(name):
        logger.warning("a request under a foreign name is refused")
        return refused(403, f"This page is for this machine alone, under {HOST}.")
    return await handler(request)


def _answer(content: bytes, kind: str, policy: str) -> web.Response:
    response = web.Response(body=content, content_type=kind, charset="utf-8")
    response.headers["Content-Security-Policy"] = policy
    return response


def _spelled(value: Any) -> Any:
    """The value as JSON can spell it: what is no number is nothing."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): _spelled(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_spelled(each) for each in value]
    return value
