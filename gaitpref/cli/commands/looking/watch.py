"""`gaitpref watch`: one live page about a run or a training."""

from __future__ import annotations

import asyncio

from data.errors import GaitprefError
from gaitpref.cli.options import options
from gaitpref.cli.shared.serving import require_port, stoppable, wait_until_stopped
from gaitpref.console.browser import open_page
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
        asyncio.run(server.serve(ready, lambda: wait_until_stopped(stopped)))
    return 0
