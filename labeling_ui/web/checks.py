"""What a request must look like before anything is done for it; pure functions."""

from __future__ import annotations

import base64
import hashlib
import ipaddress
import re
from collections.abc import Iterable, Mapping, Sequence
from urllib.parse import parse_qs

_HOST = re.compile(
    r"(?P<name>[A-Za-z0-9._-]{1,253}|\[[0-9A-Fa-f:.]{1,45}\])(:[0-9]{1,5})?"
)
_PAGE_PARAMETERS = ("darkMode", "fixedDpr", "hideViserLogo", "logCamera", "showStats")
_CAMERA = re.compile(r"initialCamera(Position|LookAt|Up|Fov|Near|Far)")
_PROTOCOL = re.compile(r"viser-v[A-Za-z0-9.+-]{1,40}")
_HANDSHAKE_KEY = re.compile(r"[A-Za-z0-9+/]{22}==")
_HANDSHAKE_VERSION = "13"

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
    address = _ip_address(host.strip("[]"))
    return address is not None and address.is_loopback


def host_name(host: str) -> str | None:
    """The name in a Host header, without the port; None if it is no host."""
    found = _HOST.fullmatch(host)
    return found["name"] if found else None


def same_origin(origin: str | None, host: str) -> bool:
    """Whether a page of this very server sent the request."""
    # Compared as text: whatever a stranger sends, there is nothing to take apart.
    own = {f"{scheme}://{host.lower()}" for scheme in ("http", "https")}
    return origin is not None and origin.lower() in own


def is_page_parameter(name: str) -> bool:
    """Whether the page may be told this in its address.

    viser's client also knows `websocket` and `playbackPath`, by which a link makes the
    genuine page obey a foreign server.
    """
    return name in _PAGE_PARAMETERS or _CAMERA.fullmatch(name) is not None


def viser_protocol(header: str) -> str | None:
    """The subprotocol viser's client asks for."""
    names: Iterable[str] = (name.strip() for name in header.split(","))
    return next((name for name in names if _PROTOCOL.fullmatch(name)), None)


def is_handshake(headers: Mapping[str, str]) -> bool:
    """Whether a request opens a websocket the way browsers do."""
    key = headers.get("Sec-WebSocket-Key", "")
    version = headers.get("Sec-WebSocket-Version", "")
    return version == _HANDSHAKE_VERSION and _HANDSHAKE_KEY.fullmatch(key) is not None


def form_field(body: bytes, name: str) -> str | None:
    """A field of a form as browsers send it; None if there is none, or more than one.

    It is UTF-8, percent-encoded, whatever the request says of itself.
    """
    try:
        fields = parse_qs(body.decode(), errors="strict", max_num_fields=8)
    except ValueError:
        return None
    values = fields.get(name, [])
    return values[0] if len(values) == 1 else None


def visitor_address(
    peer: str | None, forwarded: Sequence[str], *, proxied: bool
) -> str | None:
    """Who is at the other end of a request.

    Args:
        peer: The address the connection comes from.
        forwarded: The headers X-Forwarded-For, in their order.
        proxied: A reverse proxy on this machine is expected.
    """
    if proxied and forwarded and is_loopback(peer or ""):
        # What stands before the last comma the visitor could have written.
        return forwarded[-1].rpartition(",")[2].strip()
    return peer


def address_block(address: str | None) -> str:
    """What counts as one visitor: an IPv4 address, or the /64 around an IPv6 one."""
    parsed = _ip_address(address or "")
    if parsed is None:
        return "unknown"
    if parsed.version == 4:
        return str(parsed)
    return str(ipaddress.ip_network((parsed, 64), strict=False))


def _ip_address(text: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """An address as it is written; one of IPv4 in IPv6 is one of IPv4."""
    try:
        parsed = ipaddress.ip_address(text.partition("%")[0])
    except ValueError:
        return None
    mapped = parsed.ipv4_mapped if parsed.version == 6 else None
    return parsed if mapped is None else mapped


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


def text_policy(css: str, script: str) -> str:
    """Content-Security-Policy of our own pages: text, this one style sheet and this one
    script."""
    style, program = (
        base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        for text in (css, script)
    )
    return (
        "default-src 'none'; base-uri 'none'; form-action 'self'; "
        f"frame-ancestors 'none'; img-src data:; style-src 'sha256-{style}'; "
        f"script-src 'sha256-{program}'"
    )
