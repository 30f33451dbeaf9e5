"""Commands that torchrun has started several times, to train together.

torch is imported where it is needed: most commands have none of it to do.
"""

from __future__ import annotations

import hashlib
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from typing import TYPE_CHECKING

from gaitpref.console.progress import console

if TYPE_CHECKING:
    from policy.parallel.ranks import Ranks

_SOMETHING = "gaitpref told something"


def is_launched() -> bool:
    """Whether this is one of several processes of torchrun."""
    launched = "TORCHELASTIC_RUN_ID" in os.environ
    return launched and int(os.environ.get("WORLD_SIZE", "1")) > 1


@contextmanager
def ranks_of_launch() -> Iterator[Ranks]:
    """Who trains together; one alone where torchrun has not started this process.

    Only the first one shows progress. What ends the others, as torchrun does when one
    of them died, is an interruption.
    """
    from policy.parallel.ranks import ALONE, joined

    if not is_launched():
        yield ALONE
        return
    signal.signal(signal.SIGTERM, _interrupted)
    with joined() as ranks:
        console.quiet = not ranks.is_first
        yield ranks


def is_to_say(line: str, *, cause: bool = True) -> bool:
    """Whether this process is the one to say `line`: each line is said once, and what
    is no `cause` of an end only where nothing else was said."""
    if not is_launched():
        return True
    from torch.distributed.rendezvous import rendezvous

    try:
        store, _, _ = next(rendezvous("env://", timeout=timedelta(seconds=5)))
        is_first = store.add(_SOMETHING, 1) == 1
        digest = hashlib.sha256(line.encode()).hexdigest()
        return store.add(digest, 1) == 1 and (cause or is_first)
    except (RuntimeError, ValueError):
        # torchrun is gone, and with it whoever could say it twice.
        return True


def is_ending() -> None:
    """Hear nothing more of torchrun, which ends whoever is left when one has died: what
    this process has to say is said whole."""
    if is_launched():
        signal.signal(signal.SIGTERM, signal.SIG_IGN)


def _interrupted(signum: int, frame: object) -> None:
    raise KeyboardInterrupt
