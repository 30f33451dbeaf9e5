"""200 answers in a real browser, on any line: `python -m benchmarks.sitting`.

One simulated person presses a key as soon as the next pair is on the screen. The server
is a process of its own; with `--line-mbit 2` Chromium's own emulation lets no more
through, with as long a way (`--latency-ms`), which is what the first paint is about.
"""

from __future__ import annotations

import multiprocessing
import tempfile
import time
from contextlib import closing
from dataclasses import asdict, dataclass
from itertools import cycle
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro

from data.answers.store import AnswerStore
from data.datasets.dataset import Dataset
from labeling_ui.label_server import LabelCfg, LabelServer
from labeling_ui.questions.rater_session import QueueCfg
from tests.helpers.label_browser import launched

from .harness import publish
from .hour import AT_ONCE
from .walks import walking_dataset

if TYPE_CHECKING:
    from playwright.sync_api import Page

KEYS = "24315"
_LOADED_MS = 300_000
GOALS = {"answers_lost": "0", "key_to_row_p99_ms": "30 without a browser beside it"}
_SHOWN = "document.querySelector('[data-gp-question]')?.dataset.gpQuestion"
_PAINTED = (
    "() => performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? null"
)


@dataclass(frozen=True, kw_only=True)
class Options:
    """Answer in a real browser."""

    answers: int = 200
    """How many."""
    line_mbit: float = 0.0
    """Mbit/s of the line either way; 0: what the machine does."""
    latency_ms: float = 50.0
    """Of such a line, there and back."""
    json: Path | None = None
    """File for the figures."""


@dataclass(frozen=True, kw_only=True)
class Figures:
    """What is measured."""

    first_paint_s: float
    """From going to the address to the first words or pictures."""
    first_question_s: float
    """To the first pair with its buttons."""
    answers: int
    answers_lost: int
    """Pressed for, and not in the store."""
    key_to_row_median_ms: float
    """From the key press in the browser to the row in the data base, as another process
    sees it."""
    key_to_row_p99_ms: float
    next_pair_median_ms: float
    """From the key press to the next question on the page."""
    next_pair_p99_ms: float


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> None:
    """Measure, print and write the figures."""
    figures = asdict(measured(options))
    publish("A sitting in a real browser", figures, GOALS, options.json)


def measured(options: Options) -> Figures:
    """Serve a data set of made-up walks, and answer it."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "set"
        dataset = walking_dataset(root, pairs=options.answers + 10, episodes=40)
        here, there = multiprocessing.Pipe()
        context = multiprocessing.get_context("spawn")
        server = context.Process(target=_serve, args=(root, there))
        server.start()
        with dataset.answers() as store:
            figures = _sat(here.recv(), store, options)
        here.send("stop")
        server.join()
    return figures


def _sat(url: str, store: AnswerStore, options: Options) -> Figures:
    with launched() as browser, closing(browser.new_context()) as context:
        page = context.new_page()
        if options.line_mbit:
            _slow(page, options)
        begin_s = time.monotonic()
        # Few pixels: drawing them in software is what takes long.
        page.goto(f"{url}/?fixedDpr=0.1", wait_until="commit")
        _another(page, "", _LOADED_MS)
        question_s = time.monotonic() - begin_s
        painted_ms = page.evaluate(_PAINTED)
        page.get_by_role("button", name="Got it [escape]").click(timeout=_LOADED_MS)
        page.get_by_role("dialog").wait_for(state="detached", timeout=_LOADED_MS)
        times_ms = [
            _answered(page, store, key, number)
            for number, key in zip(range(options.answers), cycle(KEYS), strict=False)
        ]
    rows_ms, next_ms = np.array(times_ms).T
    return Figures(
        first_paint_s=painted_ms / 1000,
        first_question_s=question_s,
        answers=len(rows_ms),
        answers_lost=len(rows_ms) - store.count(),
        key_to_row_median_ms=float(np.median(rows_ms)),
        key_to_row_p99_ms=float(np.percentile(rows_ms, 99)),
        next_pair_median_ms=float(np.median(next_ms)),
        next_pair_p99_ms=float(np.percentile(next_ms, 99)),
    )


def _answered(
    page: Page, store: AnswerStore, key: str, number: int
) -> tuple[float, float]:
    """Times from a key press to the row and to the next question, ms."""
    before = page.evaluate(_SHOWN)
    begin_s = time.monotonic()
    page.keyboard.press(key)
    while store.count() <= number:
        time.sleep(0.001)
    row_s = time.monotonic() - begin_s
    _another(page, before)
    return 1000 * row_s, 1000 * (time.monotonic() - begin_s)


def _another(page: Page, before: str, longest_ms: float | None = None) -> None:
    """Wait until another question is shown than `before`."""
    shown = '[data-gp-question]:not([data-gp-question=""])'
    other = page.locator(f'{shown}:not([data-gp-question="{before}"])')
    other.first.wait_for(state="attached", timeout=longest_ms)


def _slow(page: Page, options: Options) -> None:
    bytes_per_s = options.line_mbit * 1e6 / 8
    session = page.context.new_cdp_session(page)
    session.send("Network.enable")
    session.send(
        "Network.emulateNetworkConditions",
        {
            "offline": False,
            "latency": options.latency_ms,
            "downloadThroughput": bytes_per_s,
            "uploadThroughput": bytes_per_s,
        },
    )


def _serve(root: Path, pipe: Connection) -> None:
    """Serve until told to stop, without the pauses that tell people from held keys."""
    cfg = LabelCfg(port=0, auth=False, queue=QueueCfg(guard=AT_ONCE))
    with LabelServer(Dataset.open(root), cfg) as server:
        pipe.send(server.url)
        pipe.recv()


if __name__ == "__main__":
    main(tyro.cli(Options))
