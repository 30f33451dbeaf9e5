"""The address people open where a reverse proxy stands before the page."""

from __future__ import annotations

import re
from dataclasses import dataclass

from data.errors import GaitprefError

from .checks import is_loopback

_URL = re.compile(
    r"(?P<scheme>https?)://"
    r"(?P<name>[a-z0-9._-]{1,253}|\[[0-9a-f:.]{1,45}\])(:(?P<port>[0-9]{1,5}))?"
    r"(?P<path>(/[a-z0-9._~-]+)*)/?",
    re.IGNORECASE,
)
_USUAL_PORTS = {"http": 80, "https": 443}


@dataclass(frozen=True)
class PublicUrl:
    """Where the page is for a browser; made by `parse_public_url`."""

    scheme: str
    """`http` or `https`."""
    name: str
    """Name of the host, in lower case."""
    port: int | None
    """Port; None for the usual one of the scheme, which browsers leave out."""
    path: str
    """What all addresses begin with: empty, or as `/gait`."""

    def __str__(self) -> str:
        return f"{self.origin}{self.path}/"

    @property
    def netloc(self) -> str:
        """Name and port as a browser writes them."""
        return self.name if self.port is None else f"{self.name}:{self.port}"

    @property
    def origin(self) -> str:
        """The origin as a browser sends it with a form and a websocket."""
        return f"{self.scheme}://{self.netloc}"

    @property
    def in_clear(self) -> bool:
        """What is typed there can be read on the way."""
        return self.scheme == "http" and not is_loopback(self.name)


def parse_public_url(text: str) -> PublicUrl:
    """What `--public-url` says.

    Raises:
        GaitprefError: it is no address a page could have.
    """
    found = _URL.fullmatch(text)
    wrong = _wrong(text) if found is None else ""
    port = int(found["port"]) if found and found["port"] else None
    if found is None or wrong or port == 0 or (port or 0) > 65535:
        raise GaitprefError(
            f"--public-url {text[:200]!r} {wrong or 'has no port of 1 to 65535'}; give "
            "what people open, as https://label.example.org or "
            "https://label.example.org/gait"
        )
    if {".", ".."} & set(found["path"].split("/")):
        raise GaitprefError(
            f"--public-url {text[:200]!r} has a path with . or ..; give the path as "
            "browsers show it, as https://label.example.org/gait"
        )
    scheme = found["scheme"].lower()
    return PublicUrl(
        scheme=scheme,
        name=found["name"].lower(),
        port=None if port == _USUAL_PORTS[scheme] else port,
        path=found["path"],
    )


def _wrong(text: str) -> str:
    """What keeps `text` from being an address of the page."""
    scheme, separator, rest = text.partition("://")
    if not separator or scheme.lower() not in _USUAL_PORTS:
        return "does not begin with https:// or http://"
    host, _, path = rest.partition("/")
    if "?" in rest or "#" in rest:
        return "has a query or a fragment, which no page keeps"
    if "@" in host:
        return "has a user or a password, which raters do not share"
    if not re.fullmatch(r"[A-Za-z0-9._~/-]*", path) or "//" in f"/{path}":
        return "has a path of other than letters, digits, - . _ ~ and single /"
    return "has no host name of letters, digits, - and ., with a port or without"
