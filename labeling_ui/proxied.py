"""What ties viser to the proxy in front of it.

viser listens on loopback, where every user and every browser page of the machine can
reach it; only a connection that carries the proxy's secret belongs to a rater.
"""

from __future__ import annotations

import hmac
import secrets

import viser
from websockets.datastructures import MultipleValuesError

SECRET_HEADER = "X-Proxy-Secret"
RATER_HEADER = "X-Rater"


def new_secret() -> str:
    """A secret for one run of the server; it never leaves the process."""
    return secrets.token_urlsafe(32)


def proxied_rater(server: viser.ViserServer, client_id: int, secret: str) -> str | None:
    """The rater behind a connection; None if it did not come through the proxy.

    Show nothing to such a visitor.
    """
    # The one private read: viser hands the request to no callback.
    connection = server._websock_server._live_connections.get(client_id)
    if connection is None or connection.request is None:
        return None
    try:
        shown = connection.request.headers.get(SECRET_HEADER, "")
        rater = connection.request.headers.get(RATER_HEADER)
    except MultipleValuesError:
        return None
    return rater if hmac.compare_digest(shown.encode(), secret.encode()) else None


def lock_down(server: viser.ViserServer) -> None:
    """Take away what every visitor of a viser server may ask of it.

    Any client can have a public tunnel to the server opened; hiding the button only
    hides the button.
    """
    server.request_share_url = lambda verbose=True: None
