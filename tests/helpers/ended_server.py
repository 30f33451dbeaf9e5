"""A command that serves, in a process of its own, ended while pages are open."""

from __future__ import annotations

import asyncio
import subprocess
import sys
from collections.abc import Callable, Coroutine, Sequence
from pathlib import Path
from typing import Any


def ends_well(
    arguments: Sequence[str | Path],
    meanwhile: Callable[[subprocess.Popen[str], str], Coroutine[Any, Any, None]],
    *,
    limit_s: float,
) -> None:
    """Start `gaitpref` with a port of its own, let `meanwhile`, which gets the process
    and its address, end it, and see that it speaks of no fault."""
    with subprocess.Popen(
        [sys.executable, "-m", "gaitpref", *arguments, "--port", "0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as server:
        try:
            assert server.stdout is not None
            url = server.stdout.readline().split()[-1]
            asyncio.run(meanwhile(server, url))
            said, complained = server.communicate(timeout=limit_s)
        finally:
            server.kill()
    assert server.returncode == 0
    assert "Traceback" not in said + complained, said + complained
    assert "Error" not in complained, complained
