"""How much of what people type is kept: one rule for all of it."""

from __future__ import annotations

import unicodedata

MAX_NAME_CHARS = 40
"""Of the name of a rater who has a token."""
MAX_RATER_CHARS = 200
"""Of the id of any rater; programs have longer ones than people."""
MAX_TEXT_CHARS = 1000
"""Of a note, and of the reason why a clip is bad."""


def too_long(text: str, most_chars: int = MAX_TEXT_CHARS) -> str:
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
