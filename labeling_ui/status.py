"""What the loop is doing, as the page shows it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from data.files import write_atomically


@dataclass(frozen=True)
class LoopStatus:
    """One line and a bar."""

    text: str
    """Such as "round 3 of 6: training"."""
    progress: float | None = None
    """In [0, 1]; None shows no bar."""

    def __post_init__(self) -> None:
        if self.progress is not None and not 0.0 <= self.progress <= 1.0:
            raise ValueError(f"progress must lie in [0, 1], got {self.progress}")


StatusSource = Callable[[], LoopStatus | None]
"""Asked about once a second, from one thread; None shows nothing."""


def no_status() -> LoopStatus | None:
    """There is no loop."""
    return None


def write_status(path: Path, status: LoopStatus) -> None:
    """Leave the status for a page in another process."""
    write_atomically(path, json.dumps(asdict(status)).encode())


def status_in(path: Path) -> StatusSource:
    """The status somebody writes into the file `path`; none while there is no file."""

    def read() -> LoopStatus | None:
        try:
            values = json.loads(path.read_text())
            return LoopStatus(str(values["text"])[:200], values["progress"])
        except (OSError, ValueError, KeyError, TypeError):
            return None

    return read
