"""How soon a page is back after an outage: `python -m benchmarks.outage`.

A real browser is at a real `gaitpref label`, with a note half written, when the server
is ended, stays away for so long by the clock, and is started again. It is back when it
says that it is healthy; the page is when nothing covers it and a key stores an answer.
"""

from __future__ import annotations

import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from data.answers.store import AnswerStore
from tests.helpers.label_browser import launched

from .harness import Figure, others_at_work, publish
from .walks import walking_dataset

if TYPE_CHECKING:
    from playwright.sync_api import Page

GOAL_S = 5.0
NOTE = "B drags a foot"
_LOOK_S = 0.02
_LONGEST_S = 300.0
"""For anything to come at all."""
_SHOWN = "[data-gp-question]"


@dataclass(frozen=True, kw_only=True)
class Options:
    """End the server of a page, and start it again."""

    outages_s: tuple[float, ...] = (4.0, 75.0)
    """How long it is away, s of the clock."""
    minutes: float | None = None
    """One more outage, of so many minutes."""
    json: Path | None = None
    """File for the figures."""


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> None:
    """Measure, print and write the figures."""
    outages_s = list(options.outages_s)
    outages_s += [60 * options.minutes] if options.minutes else []
    figures: dict[str, Figure] = {"others_at_work": others_at_work()}
    figures |= measured(outages_s)
    goals = {_name(s, "back_s"): f"at most {GOAL_S:g}" for s in outages_s}
    publish("Outages", figures, goals, options.json)


def measured(outages_s: list[float]) -> dict[str, Figure]:
    """One outage after the other, of one page.

    `away_s` has in it what the server takes to start. `told_s` is from its end to the
    words that say so, `back_s` from its return to a page that nothing covers,
    `answered_s` to an answer in the data base.
    """
    figures: dict[str, Figure] = {}
    with ExitStack() as open_now:
        root = Path(open_now.enter_context(tempfile.TemporaryDirectory())) / "set"
        dataset = walking_dataset(root, pairs=10 + len(outages_s))
        store = open_now.enter_context(dataset.answers())
        server = _Server(root)
        open_now.callback(server.end)
        server.begin()
        browser = open_now.enter_context(launched())
        context = open_now.enter_context(closing(browser.new_context()))
        context.set_default_timeout(1000 * _LONGEST_S)
        page = context.new_page()
        # Few pixels: drawing them in software is what takes long.
        page.goto(f"{server.url}/?fixedDpr=0.1")
        page.get_by_role("button", name="Got it [escape]").click()
        page.get_by_role("dialog").wait_for(state="detached")
        for outage_s in outages_s:
            found = _outage(page, server, store, outage_s)
            figures |= {_name(outage_s, key): value for key, value in found.items()}
    return figures


class _Server:
    """`gaitpref label` of a data set, always at one port."""

    def __init__(self, root: Path) -> None:
        with closing(socket.create_server(("127.0.0.1", 0))) as free:
            self._port = free.getsockname()[1]
        self.url = f"http://127.0.0.1:{self._port}"
        words = ("label", "--dataset", str(root), "--port", str(self._port))
        self._command = [sys.executable, "-m", "gaitpref", *words, "--no-auth"]
        self._process: subprocess.Popen[bytes] | None = None

    def begin(self) -> None:
        """Start it, and wait until it is healthy."""
        self._process = subprocess.Popen(self._command, stdout=subprocess.DEVNULL)
        _until(self._healthy)

    def end(self) -> None:
        """End it as whoever runs it does."""
        if self._process is not None:
            self._process.terminate()
            self._process.wait()

    def _healthy(self) -> bool:
        assert self._process is not None
        if self._process.poll() is not None:
            raise RuntimeError(f"the server ended with {self._process.returncode}")
        try:
            with urllib.request.urlopen(f"{self.url}/healthz", timeout=5) as answer:
                return answer.status == 200
        except OSError:
            return False


def _outage(
    page: Page, server: _Server, store: AnswerStore, outage_s: float
) -> dict[str, Figure]:
    note = page.locator("#root textarea")
    note.fill(NOTE)
    page.wait_for_timeout(1000)
    asked, answers = _question(page), store.count()
    begin_s = time.monotonic()
    server.end()
    page.locator('html[data-gp="lost"]').wait_for(state="attached")
    told_s = time.monotonic() - begin_s
    while time.monotonic() < begin_s + outage_s:
        page.wait_for_timeout(1000 * min(1.0, outage_s))
    server.begin()
    there_s = time.monotonic()
    page.locator('html[data-gp=""]').wait_for(state="attached")
    back_s = time.monotonic() - there_s
    kept = _question(page) == asked
    _until(lambda: _written(page) == NOTE, at_most_s=10.0)
    noted = _written(page) == NOTE
    note.blur()
    page.keyboard.press("2")
    _until(lambda: store.count() > answers, at_most_s=30.0)
    answers_s = time.monotonic() - there_s
    other = page.locator(f'{_SHOWN}:not([data-gp-question="{asked}"])')
    other.first.wait_for(state="attached")
    return {
        "away_s": there_s - begin_s,
        "told_s": told_s,
        "back_s": back_s,
        "question_kept": kept,
        "note_kept": noted,
        "answered_s": answers_s,
        "answers_stored": store.count() - answers,
    }


def _question(page: Page) -> str | None:
    return page.locator(_SHOWN).get_attribute("data-gp-question")


def _written(page: Page) -> str:
    return page.locator("#root textarea").input_value()


def _until(holds: Callable[[], bool], at_most_s: float = _LONGEST_S) -> None:
    """Wait until it holds, or for so long."""
    before_s = time.monotonic() + at_most_s
    while not holds() and time.monotonic() < before_s:
        time.sleep(_LOOK_S)


def _name(outage_s: float, figure: str) -> str:
    return f"{outage_s:g}_s_{figure}"


if __name__ == "__main__":
    main(tyro.cli(Options))
