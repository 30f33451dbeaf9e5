"""How many cores this process may keep busy.

Whoever runs many processes on one machine gives each its share. What comes of a
simulation does not depend on it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

CORES = "GAITPREF_CORES"
"""Environment variable with the share of a process and of those it starts."""


def cores() -> int:
    """Those this process was given a share of, or else those it may run on."""
    given = os.environ.get(CORES, "")
    if given.isdecimal() and int(given):
        return int(given)
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def given_cores(count: int) -> Iterator[None]:
    """Let this process have a share of `count` cores while the block runs."""
    before = os.environ.get(CORES)
    os.environ[CORES] = str(count)
    try:
        yield
    finally:
        if before is None:
            del os.environ[CORES]
        else:
            os.environ[CORES] = before
