"""One rule for all text that people type: how long it is, and what is in it."""

from __future__ import annotations

import unicodedata

from data.files.limits import NOTE_CHARS


def too_long(text: str, most_chars: int = NOTE_CHARS) -> str:
    """What is wrong with the length of a text; empty if nothing is."""
    if len(text) <= most_chars:
        return ""
    return f"has {len(text):,} characters, {most_chars:,} at most"


def plain_text(text: str) -> str:
    """The text without control characters, but with its lines.

    They come with what is pasted, and not every data base takes them.
    """
    if text.isprintable():
        return text
    return "".join(c for c in text if c in "\n\t" or unicodedata.category(c) != "Cc")
