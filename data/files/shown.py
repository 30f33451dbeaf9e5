"""Text of people and of files, made harmless where it is shown."""

from __future__ import annotations


def shown(text: str) -> str:
    """`text` on one line in which nothing acts: what cannot be seen is spelled out.

    A terminal obeys control characters, and marks of direction reorder what is read.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else _spelled(c) for c in text)


def shown_lines(text: str) -> str:
    """Text of several lines, made harmless where it is shown."""
    return "\n".join(map(shown, text.split("\n")))


def _spelled(character: str) -> str:
    return character.encode("unicode_escape").decode()
