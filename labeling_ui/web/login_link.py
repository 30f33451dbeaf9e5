"""A rater's login link, as text and to be scanned."""

from __future__ import annotations

import io

import segno
from yarl import URL

from data.errors import GaitprefError


def require_url(url: str) -> None:
    """Make sure that a page can be opened there.

    Raises:
        GaitprefError: it is no address of a page.
    """
    try:
        parsed = URL(url)
    except ValueError:
        parsed = URL()
    if parsed.scheme not in ("http", "https") or not parsed.host or parsed.fragment:
        raise GaitprefError(
            f"--url {url!r} is no address of a page; say where raters open it, such as "
            "https://gaits.example.org"
        )


def login_link(url: str, token: str) -> str:
    """The link that logs in: what follows its # reaches no server and no log."""
    return f"{url.rstrip('/')}/login#token={token}"


def qr_lines(link: str) -> list[str]:
    """The link to be scanned from a terminal, dark or light."""
    drawn = io.StringIO()
    segno.make(link, error="l", micro=False).terminal(drawn, border=2, compact=True)
    return drawn.getvalue().rstrip("\n").split("\n")
