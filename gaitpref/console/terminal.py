"""What commands say: nothing in it acts, and every output can show it."""

from __future__ import annotations

import codecs
import errno
import io
import os
import sys
import threading
from collections.abc import Iterable
from typing import Any

from rich.console import Console
from rich.text import Text

from data.files.faults import told
from data.files.shown import shown, shown_lines

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130
"""Exit code of a command that the user ended."""

_PLAIN = {
    "\N{BULLET}": "*",
    "\N{PLUS-MINUS SIGN}": "+-",
    "\N{EN DASH}": "-",
    "\N{EM DASH}": "-",
    "\N{HORIZONTAL ELLIPSIS}": "...",
    "\N{RIGHTWARDS ARROW}": "->",
    "\N{MIDDLE DOT}": ".",
}
_HANDLER = "gaitpref.plain"
UNSAID: list[str] = []
"""What went wrong in threads and was not said yet."""


class PlainConsole(Console):
    """A console that takes text for text: no markup, no emoji, nothing that acts."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(markup=False, emoji=False, highlight=False, **settings)

    def render_str(self, text: str, **settings: Any) -> Text:
        """The text that is drawn, in tables too."""
        return super().render_str(shown_lines(text), **settings)

    def next(self, text: str) -> None:
        """Say what comes next, at the end of a command that has said all else."""
        finish()
        self.print(f"next: {text}")

    def alarm(self, text: str) -> None:
        """Say what somebody should look at."""
        head = Text("ALARM", style="bold red")
        self.print(Text.assemble(head, " ", shown_lines(text)))


def say(text: str = "") -> None:
    """A line of standard output, or several."""
    print(shown_lines(text))


def complain(line: str, more: str = "") -> None:
    """One line on standard error, and `more` below it."""
    try:
        print(f"gaitpref: {shown(line)}", file=sys.stderr)
        if more:
            print(shown_lines(more), file=sys.stderr)
    except OSError:
        # Nobody is there to read it; the exit code says enough.
        return


class _Closed(io.TextIOBase):
    """Stands where the caller has closed an output."""

    def write(self, text: str) -> int:
        """Refuse it, as any program does that loses what it was asked for."""
        raise OSError(errno.EBADF, os.strerror(errno.EBADF), "standard output")


def prepare() -> None:
    """Make the standard streams usable, whatever the caller gave.

    What an output has no letter for is spelled otherwise, and no file that is opened
    later gets the number of a stream that is closed.
    """
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    if sys.stdout is None:
        sys.stdout = _Closed()
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115
    UNSAID.clear()
    threading.excepthook = keep_for_later
    codecs.register_error(_HANDLER, _spelled)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_HANDLER)


def keep_for_later(failed: threading.ExceptHookArgs) -> None:
    """Take what a thread failed of: who waits for it says so, or the end does."""
    error = failed.exc_value
    line = told(error) if isinstance(error, OSError) else None
    if line is None:
        threading.__excepthook__(failed)
    else:
        UNSAID.append(line)


def finish() -> None:
    """Wait until everything that was said is out.

    Raises:
        BrokenPipeError: the reader has gone.
        OSError: it cannot be written; the error names standard output.
    """
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OSError(error.errno, error.strerror, "standard output") from error


def drop_output() -> None:
    """Forget what standard output did not take, so that the end is a quiet one."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _spelled(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    letters: Iterable[str] = error.object[error.start : error.end]
    plain = (_PLAIN.get(c) or c.encode("unicode_escape").decode() for c in letters)
    return "".join(plain), error.end
