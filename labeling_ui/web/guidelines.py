"""What raters are told to look for."""

from __future__ import annotations

from pathlib import Path

from data.errors import GaitprefError
from data.files.files import read_text
from data.files.limits import GUIDELINES_BYTES

DEFAULT_GUIDELINES = """\
Two robots, **A** (blue) and **B** (orange), were given the same command. Say which one
walks better, or, where they begin lying, gets up better.

- Look at how it moves: steady, quiet, in step with the command.
- A fall is worse than any way of walking.
- If both are equally good, say so; if you can't tell, say that.
- If you can name what decides it, say so before you answer (*because of* posture, feet,
  rhythm, ...): it helps as much as another answer, and is never needed.
- A clip that shows nothing sensible is a *bad clip*.

Slow down, step, or turn the scene with the mouse as much as you like. There is no hurry
and no score, and every answer can be undone.
"""


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
