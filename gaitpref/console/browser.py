"""A page in the browser of whoever typed the command."""

from __future__ import annotations

import threading
import webbrowser

from .progress import console

_WAIT_S = 1.0
"""Enough for one to start, or to fail."""

_IN_TERMINAL = ("elinks", "links", "lynx", "w3m", "www-browser")


def open_page(url: str) -> None:
    """Open the page, or say that this machine has no browser."""
    try:
        found = webbrowser.get()
    except webbrowser.Error:
        found = None
    if found is None or _in_terminal(found):
        console.print(f"no browser is found here (--open): open {url} yourself")
        return

    def show() -> None:
        if not found.open(url):
            console.print(f"the browser does not start (--open): open {url} yourself")

    # Some are waited for until somebody closes them, which must keep nothing waiting.
    thread = threading.Thread(target=show, name="browser", daemon=True)
    thread.start()
    thread.join(_WAIT_S)


def has_browser() -> bool:
    """Whether `open_page` would find one."""
    try:
        return not _in_terminal(webbrowser.get())
    except webbrowser.Error:
        return False


def _in_terminal(found: webbrowser.BaseBrowser) -> bool:
    """Whether it would take the terminal that the command writes to, as lynx does."""
    return getattr(found, "name", "") in _IN_TERMINAL
