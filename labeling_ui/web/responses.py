"""The few kinds of answers the proxy gives itself."""

from __future__ import annotations

from aiohttp import web

from .checks import SECURITY_HEADERS, text_policy
from .pages import CSS, LINK_SCRIPT


def page(text: str, *, status: int = 200) -> web.Response:
    """One of our own pages."""
    response = web.Response(text=text, status=status, content_type="text/html")
    response.headers["Content-Security-Policy"] = text_policy(CSS, LINK_SCRIPT)
    return response


def refused(status: int, reason: str) -> web.Response:
    """A request that is turned away, and why, in one line."""
    return web.Response(text=f"{reason}\n", status=status)


def redirect(path: str) -> web.Response:
    """Go to another page of this server."""
    return web.Response(status=303, headers={"Location": path})


async def add_security_headers(
    request: web.Request, response: web.StreamResponse
) -> None:
    """Put on every response what tells a browser to be careful."""
    for name, value in SECURITY_HEADERS.items():
        response.headers[name] = value
