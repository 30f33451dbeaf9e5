"""What a request must look like before anything is done for it; pure functions."""

from __future__ import annotations

import base64
import hashlib
import ipaddress
import re
from collections.abc import Iterable
from urllib.parse import urlsplit

_HOST = re.compile(r"(?P<name>[A-Za-z0-9._-]+|\[[0-9A-Fa-f:.]+\])(:\d{1,5})?")
_PAGE_PARAMETERS = ("darkMode", "fixedDpr", "hideViserLogo", "logCamera", "showStats")
_CAMERA = re.compile(r"initialCamera(Position|LookAt|Up|Fov|Near|Far)")

SECURITY_HEADERS = {
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
    # Not "no-referrer": browsers then send no usable Origin with a form.
    "Referrer-Policy": "same-origin",
    "Server": "gaitpref",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach a server on `host`."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def host_name(host: str) -> str | None:
    """The name in a Host header, without the port; None if it is no host."""
    found = _HOST.fullmatch(host)
    return found["name"] if found else None


def same_origin(origin: str | None, host: str) -> bool:
    """Whether a page of this very server sent the request."""
    if origin is None:
        return False
    parts = urlsplit(origin)
    return parts.scheme in ("http", "https") and parts.netloc.lower() == host.lower()


def is_page_parameter(name: str) -> bool:
    """Whether the page may be told this in its address.

    viser's client also knows `websocket` and `playbackPath`, by which a link makes the
    genuine page obey a foreign server.
    """
    return name in _PAGE_PARAMETERS or _CAMERA.fullmatch(name) is not None


def viser_protocol(header: str) -> str | None:
    """The subprotocol viser's client asks for."""
    names: Iterable[str] = (name.strip() for name in header.split(","))
    return next((name for name in names if name.startswith("viser-v")), None)


def address_block(address: str | None) -> str:
    """What counts as one visitor: an IPv4 address, or the /64 around an IPv6 one."""
    try:
        parsed = ipaddress.ip_address((address or "").partition("%")[0])
    except ValueError:
        return "unknown"
    if parsed.version == 4:
        return str(parsed)
    return str(ipaddress.ip_network((parsed, 64), strict=False))


def page_policy(host: str) -> str:
    """Content-Security-Policy of viser's page.

    Its bundle is an inline script that unpacks itself with WebAssembly and starts a
    worker from a blob. Inline handlers and `eval` stay forbidden, and so is every
    foreign address. (viser's sorter of Gaussian splats wants `eval` and does not start;
    the page has none.)
    """
    # Older browsers do not count a websocket to the same host as 'self'.
    sockets = f"ws://{host} wss://{host}"
    return (
        "default-src 'none'; base-uri 'none'; form-action 'self'; "
        "frame-ancestors 'none'; object-src 'none'; "
        "script-src 'unsafe-inline' 'wasm-unsafe-eval'; script-src-attr 'none'; "
        "worker-src blob: data:; style-src 'unsafe-inline'; font-src data:; "
        "img-src 'self' data: blob:; "
        f"connect-src 'self' data: blob: {sockets}"
    )


def text_policy(css: str) -> str:
    """Content-Security-Policy of our own pages: text and this one style sheet."""
    digest = base64.b64encode(hashlib.sha256(css.encode()).digest()).decode()
    return (
        "default-src 'none'; base-uri 'none'; form-action 'self'; "
        f"frame-ancestors 'none'; img-src data:; style-src 'sha256-{digest}'"
    )
