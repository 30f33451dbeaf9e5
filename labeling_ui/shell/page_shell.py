"""viser's page in a shell of our own: title, icon, what is told while it loads or its
connection is lost, keys and names.

The browser gets it before the megabyte of viser's own program, and shows it at once.
"""

from __future__ import annotations

import hashlib
import html
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib import resources
from typing import Any

from .key_map import KeyGroup, key_map, key_strip

ICON = (
    "data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 32 32'"
    "%3E%3Crect width='32' height='32' rx='7' fill='%231c5cbe'/%3E%3Cpath d='M6 11h14"
    "l5-3M8 11l-2 7 4 7M19 11l3 7-3 7' fill='none' stroke='white' stroke-width='3' "
    "stroke-linecap='round' stroke-linejoin='round'/%3E%3C/svg%3E"
)
_SCRIPTS = ("line.js", "hands.js", "drafts.js", "gamepad.js")
_HEAD = re.compile(rb"<head>")
_THEIRS = re.compile(rb'<title>.*?</title>|<link\s+rel="icon".*?/>', re.DOTALL)
_WORDS = {
    "covers": {
        "loading": {
            "title": "gaitpref",
            "text": "The page is loading. On a slow line this takes up to a minute.",
        },
        "lost": {
            "title": "Connection lost",
            "text": "Trying again, all the time. Your answers are kept, and so are "
            "this pair and your note. Keys that you press now are not stored.",
        },
        "away": {
            "title": "Open in another window",
            "text": "You opened this page once more, and only the newest window takes "
            "answers.",
            "button": "Go on here",
        },
    },
    "back": "The connection is back.",
    "missed": "Not stored, as there was no connection:",
    "progress": "Share of the pairs that you have answered",
    "slider": "Time",
    "icon": "Commands",
}


@dataclass(frozen=True, kw_only=True)
class Shell:
    """What is put around viser's page."""

    title: str
    """Behind "gaitpref - " in the browser's tab."""
    scene: str
    """What is seen, for who does not see it."""
    keys: tuple[KeyGroup, ...] = ()
    """All keys."""
    strip: tuple[tuple[str, str], ...] = ()
    """The most used keys, and what they do."""
    taps: tuple[tuple[str, str], ...] = ()
    """Keys that a phone, which has no room for their buttons, gets over the scene."""
    words: Mapping[str, Any] = field(default_factory=dict)
    """What the script has to know of the page besides."""

    @cached_property
    def version(self) -> str:
        """Changes with everything that an open page would have to load anew."""
        return hashlib.sha256(self._written("").encode()).hexdigest()[:16]

    def _written(self, version: str) -> str:
        """All that comes before viser's own program."""
        style, *scripts = (_file(name) for name in ("shell.css", *_SCRIPTS))
        own = {"scene": self.scene, "version": version}
        told = {**_WORDS, **own, **self.words}
        # Nothing in it may end the script.
        words = json.dumps(told).replace("<", "\\u003c")
        script = "\n".join((f"const words = {words};", *scripts))
        return (
            '<meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>gaitpref - {self.title}</title>"
            f'<link rel="icon" href="{ICON}"><style>{style}</style></head><body>'
            f"{self._body}<script>(() => {{\n{script}}})();</script>"
        )

    @property
    def _body(self) -> str:
        loading = _WORDS["covers"]["loading"]
        return (
            '<div id="gp-cover"><div class="gp-card" role="alert">'
            f'<h1 id="gp-title">{loading["title"]}</h1>'
            f'<p id="gp-text">{loading["text"]}</p><p id="gp-missed"></p>'
            '<div class="gp-bar"></div>'
            '<button type="button" class="gp-button" id="gp-act" hidden></button>'
            '</div></div><div id="gp-toast" role="status" hidden></div>'
            '<div id="gp-live" role="status"></div>'
            f"{key_strip(self.strip)}{_taps(self.taps)}{key_map(self.keys)}{_SMALL}"
        )

    def around(self, page: bytes) -> bytes:
        """viser's page in this shell; ours comes first, and what follows is body.

        Raises:
            ValueError: it is no page with a head.
        """
        head = _HEAD.search(page)
        if head is None:
            raise ValueError("viser's page has no <head>")
        start = head.end()
        # Behind the first script is viser's program, in which nothing is looked for.
        program = page.index(b"<script", start)
        ours = self._written(self.version).encode()
        theirs = _THEIRS.sub(b"", page[start:program])
        return page[:start] + ours + theirs + page[program:]


def _taps(taps: tuple[tuple[str, str], ...]) -> str:
    buttons = "".join(
        f'<button type="button" data-gp-press="{html.escape(key)}">'
        f"{html.escape(does)}</button>"
        for key, does in taps
    )
    return f'<div id="gp-taps">{buttons}</div>'


_SMALL = (
    '<div id="gp-small"><div class="gp-card"><h1>A larger screen, please</h1>'
    "<p>Two robots side by side and what belongs to them do not fit here. Open this "
    "address on a tablet, held across, or on a computer: your answers are kept, and "
    "you go on where you are.</p>"
    '<button type="button" class="gp-button" data-gp-anyway>Try it all the same'
    "</button></div></div>"
)


def _file(name: str) -> str:
    return (
        resources.files("labeling_ui.shell")
        .joinpath("browser", name)
        .read_text("utf-8")
    )
