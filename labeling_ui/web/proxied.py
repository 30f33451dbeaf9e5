"""What ties viser to the proxy in front of it.

viser listens on loopback, where every user and every browser page of the machine can
reach it; only a connection that carries the proxy's secret belongs to a rater, and no
other is let in.
"""

from __future__ import annotations

import hmac
import logging
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from http import HTTPStatus
from typing import Any

import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers, MultipleValuesError
from websockets.http11 import Request, Response

from labeling_ui.limits.page_limits import INNER_WAITING

SECRET_HEADER = "X-Proxy-Secret"
RATER_HEADER = "X-Rater"
VISIT_HEADER = "X-Visit"
_quiet = logging.getLogger(f"{__name__}.inner")
_quiet.setLevel(logging.CRITICAL)
"""Strangers on loopback must not fill the log; what concerns raters the relay says."""


def new_secret() -> str:
    """A secret for one run of the server; it never leaves the process."""
    return secrets.token_urlsafe(32)


@contextmanager
def only_for(secret: str) -> Iterator[None]:
    """A viser server that is made in here answers only who shows `secret`.

    viser has no hook for that: it calls `websockets`' `serve`, once, while it is made.
    Everybody else gets a 403 in the handshake, before viser reads or keeps anything.
    """
    waiting: dict[ServerConnection, None] = {}

    class Connection(ServerConnection):
        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            waiting[self] = None
            if len(waiting) > INNER_WAITING:
                # The proxy says at once who it is.
                next(iter(waiting)).transport.abort()

        def connection_lost(self, exc: Exception | None) -> None:
            waiting.pop(self, None)
            super().connection_lost(exc)

    def guarded(*args: Any, process_request: Any, **options: Any) -> serve:
        def checked(connection: ServerConnection, request: Request) -> Any:
            waiting.pop(connection, None)
            if not _shows(request.headers, secret):
                return Response(HTTPStatus.FORBIDDEN, "Forbidden", Headers())
            return process_request(connection, request)

        options |= {"create_connection": Connection, "logger": _quiet, "backlog": 4}
        return serve(*args, process_request=checked, **options)

    websockets.asyncio.server.serve = guarded
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve


def proxied_rater(server: viser.ViserServer, client_id: int, secret: str) -> str | None:
    """The rater behind a connection; None if it did not come through the proxy.

    Show nothing to such a visitor.
    """
    headers = _headers(server, client_id)
    if headers is None or not _shows(headers, secret):
        return None
    return headers.get(RATER_HEADER)


def proxied_visit(server: viser.ViserServer, client_id: int) -> str | None:
    """Which of the proxy's visits a connection belongs to."""
    headers = _headers(server, client_id)
    return None if headers is None else headers.get(VISIT_HEADER)


def lock_down(server: viser.ViserServer) -> None:
    """Take away what every visitor of a viser server may ask of it.

    Any client can have a public tunnel to the server opened; hiding the button only
    hides the button.
    """
    server.request_share_url = lambda verbose=True: None


def _headers(server: viser.ViserServer, client_id: int) -> Headers | None:
    # The one private read: viser hands the request to no callback.
    connection = server._websock_server._live_connections.get(client_id)
    if connection is None or connection.request is None:
        return None
    return connection.request.headers


def _shows(headers: Headers, secret: str) -> bool:
    try:
        shown = headers.get(SECRET_HEADER, "")
    except MultipleValuesError:
        return False
    return hmac.compare_digest(shown.encode(errors="replace"), secret.encode())
