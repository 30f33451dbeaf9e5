"""The labeling page beside the loop, up over all rounds.

It is a process of its own: training holds the interpreter for long, and the page would
stutter. One pipe joins the two. The loop sends what it is doing; when the loop is gone,
however it ended, the pipe ends, and so does the page.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

from data.answers.answer_records import Answer, Pair
from data.datasets.dataset import Dataset
from data.errors import GaitprefError
from gaitpref.console.deaf_children import beside
from labeling_ui.label_server import LabelCfg, LabelServer
from labeling_ui.page.loop_status import LoopStatus

_START_S = 120.0
NICENESS = 5
"""Niceness of the loop: who answers must not wait for a training of minutes."""


class LoopPage:
    """The page as the loop sees it."""

    def __init__(self, process: BaseProcess, pipe: Connection, url: str) -> None:
        self._process, self._pipe, self.url = process, pipe, url

    def announce(self, status: LoopStatus) -> None:
        """Show on the page what the loop is doing; harmless where the page is gone."""
        try:
            self._pipe.send(status)
        except OSError:
            return

    def require(self) -> None:
        """Make sure that the page is up.

        Raises:
            GaitprefError: it is not.
        """
        if not self._process.is_alive():
            raise GaitprefError(
                "the labeling page has ended (exit code "
                f"{self._process.exitcode}); all answers are kept, and the same "
                "command goes on"
            )


@contextmanager
def loop_page(root: Path, cfg: LabelCfg) -> Iterator[tuple[list[str], LoopPage]]:
    """Serve the page of the data set `root` while the block runs.

    Gives what whoever started it has to know too, line by line.

    Raises:
        GaitprefError: the page cannot be served, as where the port is busy.
    """
    with beside(_serve, root, cfg, name="page") as (process, pipe):
        url, notices = _greeting(pipe)
        yield notices, LoopPage(process, pipe, url)


def _greeting(pipe: Connection) -> tuple[str, list[str]]:
    """Where the page is and what it says of itself, once it is up.

    Raises:
        GaitprefError: it does not come up.
    """
    try:
        if pipe.poll(_START_S):
            url, notices, refusal = pipe.recv()
            if refusal:
                raise GaitprefError(refusal)
            return url, notices
    except (EOFError, OSError):
        pass
    raise GaitprefError("the labeling page does not start; see its message above")


class _Latest:
    """The last status that came through the pipe."""

    def __init__(self) -> None:
        self.status: LoopStatus | None = None

    def read(self) -> LoopStatus | None:
        return self.status


def _picture(run: Path, pair: Pair, answer: Answer) -> str:
    # torch is loaded for who asks, and by no page that nobody asks.
    from gaitpref.report.page_pictures import newest_picture

    return newest_picture(run, pair, answer)


def _serve(root: Path, cfg: LabelCfg, pipe: Connection) -> None:
    # It hears no Ctrl-C: the loop saves first, and the page stays until it has. That
    # the loop is gone is what the pipe says.
    latest = _Latest()
    try:
        dataset, picture = Dataset.open(root), partial(_picture, root.parent)
        server = LabelServer(dataset, cfg, status=latest.read, picture=picture)
        server.start()
    except GaitprefError as error:
        pipe.send(("", [], str(error)))
        return
    pipe.send((server.url, server.notices, ""))
    try:
        while True:
            latest.status = pipe.recv()
    except (EOFError, OSError):
        # A server that shuts down orderly keeps the port for seconds, and the next
        # loop may want it at once. Every answer that was counted is on the disk.
        os._exit(0)
