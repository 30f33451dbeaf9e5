"""What raters are told to look for."""

from __future__ import annotations

import logging
from pathlib import Path

from data.errors import GaitprefError
from data.files.files import read_text
from data.files.limits import GUIDELINES_BYTES

logger = logging.getLogger(__name__)

DEFAULT_GUIDELINES = """\
Two robots, **A** (blue) and **B** (orange), were given the same command. Say which one
walks better, or, where they begin lying, gets up better.

- Look at how it moves: steady, quiet, in step with the command.
- A fall is worse than any way of walking.
- If both are equally good, say so; if you can't tell, say that.
- *Because of* (posture, feet, rhythm, ...) is a tap that may always be left out. It
  helps most in the first few answers, and one that is a guess misleads.
- A clip that shows nothing sensible is a *bad clip*.

Slow down, step, or turn the scene with the mouse as much as you like. There is no hurry
and no score, and every answer can be undone.
"""


class Guidelines:
    """What raters are told, read anew each time: the owner goes on writing, and sees
    it in the browser as raters do."""

    def __init__(self, path: Path | None) -> None:
        """Read them once.

        Raises:
            GaitprefError: the file cannot be read, or is no text.
        """
        self._path, self._last = path, load_guidelines(path)

    def __call__(self) -> str:
        """The Markdown as it is now; the last that could be read while an editor
        writes it, or where it was moved."""
        try:
            # An editor may have emptied the file, and be about to write it.
            self._last = load_guidelines(self._path) or self._last
        except GaitprefError as error:
            logger.warning("%s; people see the text of before", error)
        return self._last


def load_guidelines(path: Path | None) -> str:
    """The Markdown text in the file `path`, or what is said by default.

    Raises:
        GaitprefError: the file cannot be read, or is no text.
    """
    if path is None:
        return DEFAULT_GUIDELINES
    try:
        return read_text(path, GUIDELINES_BYTES)
    except (OSError, ValueError) as error:
        raise GaitprefError(
            f"the guidelines {path} cannot be used ({error}); give a Markdown file"
        ) from None
