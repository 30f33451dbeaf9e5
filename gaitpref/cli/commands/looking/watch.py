"""`gaitpref watch`: one live page about a run or a training."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable

from data.errors import GaitprefError
from gaitpref.cli.options import options
from gaitpref.cli.shared.next_of_run import next_of_run
from gaitpref.cli.shared.serving import require_port, stoppable, wait_until_stopped
from gaitpref.console.browser import open_page
from gaitpref.console.extras import require
from gaitpref.console.progress import console
from gaitpref.console.terminal import say
from gaitpref.watch.watch_server import WatchServer


def run(command: options.Watch) -> int:
    """Serve the page until it is stopped; gives the exit code."""
    require_port(command.port)
    if command.run.exists() and not command.run.is_dir():
        raise GaitprefError(
            f"{command.run} is no directory: give that of `gaitpref loop --run`, or of "
            f"`gaitpref train --out`"
        )
    server = WatchServer(command.run, command.port)

    def ready() -> None:
        say(f"the run is at {server.url}")
        if not command.run.exists():
            console.print(
                f"{command.run} is not there yet, and the page waits for it: "
                f"`gaitpref loop --run {command.run}` makes it"
            )
        if command.open:
            open_page(server.url)

    with stoppable() as stopped:
        mirrored = _mirrored(command, stopped)
        try:
            asyncio.run(server.serve(ready, lambda: wait_until_stopped(stopped)))
        finally:
            stopped.set()
            mirrored()
    console.next(next_of_run(command.run))
    return 0


def _mirrored(command: options.Watch, stopped: threading.Event) -> Callable[[], None]:
    """Send the run elsewhere as long as it is watched, if that is asked for; gives what
    waits for the last of it.

    Raises:
        GaitprefError: the client is not installed, or nobody is logged in.
    """
    if command.wandb is None:
        return lambda: None
    mirror = require("gaitpref.watch.wandb_mirror", "wandb").WandbMirror(
        command.run, command.wandb
    )
    say(f"it is sent to {mirror.url or 'files, for `wandb sync`'}")
    return mirror.beside(stopped)
