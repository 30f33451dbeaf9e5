"""Tables that programs write into pages, between lines that say where."""

from __future__ import annotations

from pathlib import Path

from data.errors import GaitprefError
from data.files.files import write_atomically

NOT_MEASURED = "not measured"


def between(mark: str, text: str) -> str:
    """`text` between the lines of a page that say where it begins and ends."""
    return f"<!-- {mark}: begin -->\n\n{text}\n\n<!-- {mark}: end -->\n"


def write_between(page: Path, mark: str, text: str) -> None:
    """Replace what stands between the lines of `mark` in `page`.

    Raises:
        GaitprefError: The page lacks them.
    """
    begin, end = f"<!-- {mark}: begin -->\n", f"<!-- {mark}: end -->\n"
    head, found, rest = page.read_text().partition(begin)
    _, closed, tail = rest.partition(end)
    if not (found and closed):
        raise GaitprefError(
            f"{page} has no lines {begin.strip()} and {end.strip()}: add them where "
            "the table is to stand"
        )
    write_atomically(page, (head + between(mark, text) + tail).encode())
