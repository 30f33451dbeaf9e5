"""Waiting for what another process does."""

from __future__ import annotations

import time
from collections.abc import Callable

_LONGEST_S, _LOOK_S = 300.0, 0.005


def wait_for(reached: Callable[[], bool]) -> None:
    """Until something is so, within five minutes."""
    deadline_s = time.monotonic() + _LONGEST_S
    while not reached():
        assert time.monotonic() < deadline_s
        time.sleep(_LOOK_S)
