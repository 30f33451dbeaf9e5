"""What a piece of work says, in a file of its own."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def said_into(log: Path | None) -> Iterator[None]:
    """Add to the file `log` what this process says while the block runs, libraries that
    are no Python included, and what the block raises; with None, nothing changes.

    Raises:
        OSError: the file cannot be written.
    """
    if log is None:
        yield
        return
    log.parent.mkdir(parents=True, exist_ok=True)
    file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
    before = [os.dup(stream) for stream in (1, 2)]
    _turn([file, file])
    try:
        yield
    except BaseException:
        traceback.print_exc()
        raise
    finally:
        _turn(before)


def _turn(targets: list[int]) -> None:
    """Let both standard outputs write to these descriptors, and close those."""
    sys.stdout.flush()
    sys.stderr.flush()
    for stream, target in zip((1, 2), targets, strict=True):
        os.dup2(target, stream)
    for target in set(targets):
        os.close(target)
