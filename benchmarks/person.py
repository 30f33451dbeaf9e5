"""What a person waits in a loop: `python -m benchmarks.person [--serial]`.

A simulated person sits before a real browser, looks at every pair for five seconds and
says which one the criterion prefers. With `--serial` the loop asks nothing while it
trains, as with `meanwhile=None`. Who answers in less time, or never leaves, is neither.
"""

from __future__ import annotations

import multiprocessing
import socket
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from data.answers.overlap import Overlap
from data.answers.question_board import QuestionBoard
from data.datasets.dataset import Dataset
from data.files.files import read_json
from gaitpref.cli.commands.loop import page_of_loop
from gaitpref.cli.options.options import Loop, Serving
from gaitpref.loop.loop_cfg import LoopCfg
from gaitpref.loop.presets import loop_cfg
from gaitpref.loop.run import run_loop
from gaitpref.loop.run_dir import Round
from gaitpref.loop.run_inputs import inputs_of
from gaitpref.raters.error_model import better
from gaitpref.raters.simulated import ClipScores
from labeling_ui.page.shortcuts import VERDICTS
from tests.helpers.label_browser import launched

from .harness import Figure, others_at_work, publish
from .preference_table import read_rows

if TYPE_CHECKING:
    from playwright.sync_api import Page

RATER = "local"
"""Who answers at a page without tokens."""
REFERENCES = Path(__file__).parents[1] / "docs" / "results" / "preferences"
"""Rows that know what PPO gains that sees the criterion, from the walk that ships."""
GOALS = {"minutes_to_verdict": "at most 12", "waiting_share": "at most 0.20"}
_LOOK_S = 0.05
_LOADED_MS = 300_000
_SHOWN = "() => document.querySelector('[data-gp-question]')?.dataset.gpQuestion ?? ''"
_KEYS = {verdict.verdict: verdict.key for verdict in VERDICTS}


@dataclass(frozen=True, kw_only=True)
class Options:
    """Measure what a person waits for."""

    serial: bool = False
    """Ask nothing while the loop trains."""
    preset: Literal["quick", "standard"] = "quick"
    """How long the loop is, as of `gaitpref loop --preset`."""
    labels: int = 40
    """Answers in all that the loop asks for."""
    rounds: int | None = None
    """Times it asks and retrains; the preset's by default."""
    steps: int | None = None
    """Environment steps of each training; the preset's by default."""
    criterion: str = "high_step"
    """What the person looks for."""
    look_s: float = 5.0
    """How long the person looks at a pair."""
    seed: int = 0
    """Of the loop."""
    port: int = 8094
    """Of the page."""
    run: Path | None = None
    """Directory of the run, which is kept; a temporary one by default."""
    json: Path | None = None
    """File for the figures."""


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> None:
    """Measure, print and write the figures."""
    with tempfile.TemporaryDirectory() as folder:
        run, others = options.run or Path(folder) / "run", others_at_work()
        figures = measured(options, run) | {"others_at_work": others}
    publish("A person at the loop", figures, GOALS, options.json)


def measured(options: Options, run: Path) -> dict[str, Figure]:
    """Run the loop with the person in it."""
    cfg = loop_cfg(
        criterion=options.criterion,
        labels=options.labels,
        rounds=options.rounds,
        steps=options.steps,
        rater="human",
        quick=options.preset == "quick",
        seed=options.seed,
    )
    if options.serial:
        cfg = replace(cfg, method=replace(cfg.method, meanwhile=None))
    loop = multiprocessing.get_context("spawn").Process(
        target=_loop, args=(run, cfg, options.port)
    )
    begin_s = time.monotonic()
    loop.start()
    sitting = _Sitting(run, cfg, options.look_s)
    try:
        seen = sitting.until_verdict(loop.is_alive, options.port)
    except BaseException:
        loop.terminate()
        raise
    ended_s = time.monotonic() - begin_s
    loop.join()
    if loop.exitcode:
        raise RuntimeError(f"the loop ended with {loop.exitcode}")
    return _figures(run, cfg, seen, begin_s, ended_s)


def _loop(run: Path, cfg: LoopCfg, port: int) -> None:
    asked = Loop(run=run, rater="human", page=Serving(port=port, no_auth=True))
    run_loop(run, cfg, open_page=partial(page_of_loop, asked))


@dataclass(frozen=True, kw_only=True)
class _Seen:
    """What became of a person's time, s."""

    first_pair_s: float
    """Monotonic clock when the first pair was there."""
    looking_s: float
    """With a pair on the screen."""
    answers: int
    """As the person counts them."""
    waits_s: tuple[tuple[float, str], ...]
    """Without one, each with what the page said the loop did."""


class _Sitting:
    """A person before a browser, from the first page to the verdict of a run."""

    def __init__(self, run: Path, cfg: LoopCfg, look_s: float) -> None:
        self._run, self._look_s = run, look_s
        self._verdict = Round(run, cfg.rounds).verdict
        self._criterion = inputs_of(cfg).criterion
        self._looking_s, self._answers = 0.0, 0
        self._waits: list[tuple[float, str]] = []

    def until_verdict(self, alive: Callable[[], bool], port: int) -> _Seen:
        """Answer whatever is shown."""
        with launched() as browser, closing(browser.new_context()) as context:
            page = context.new_page()
            while not _listens(port):
                if not alive():
                    raise RuntimeError("the loop ended before its page was there")
                time.sleep(_LOOK_S)
            # Few pixels: drawing them in software is what takes long.
            page.goto(f"http://127.0.0.1:{port}/?fixedDpr=0.1", timeout=_LOADED_MS)
            page.wait_for_selector(
                "[data-gp-question]", state="attached", timeout=_LOADED_MS
            )
            first_s, shown = 0.0, ""
            while not self._verdict.exists() and alive():
                shown = self._next(page, shown)
                if not shown:
                    continue
                first_s = first_s or time.monotonic()
                self._answer(page, shown)
        return _Seen(
            first_pair_s=first_s,
            looking_s=self._looking_s,
            answers=self._answers,
            waits_s=tuple(self._waits),
        )

    def _next(self, page: Page, before: str) -> str:
        """Wait for another question than the one before; "" where the run has ended."""
        begin_s = time.monotonic()
        while not self._verdict.exists():
            shown = page.evaluate(_SHOWN)
            if shown and shown != before:
                self._waits.append((time.monotonic() - begin_s, self._doing(page)))
                return shown
            time.sleep(_LOOK_S)
        return ""

    @staticmethod
    def _doing(page: Page) -> str:
        found = page.get_by_text("round").all_inner_texts()
        return next((text for text in found if " of " in text or "last" in text), "")

    def _answer(self, page: Page, question_id: str) -> None:
        """Look at the pair, then press the key until the page has taken it."""
        begin_s = time.monotonic()
        dataset = Dataset.open(self._run / "dataset")
        with dataset.answers() as store:
            shown = QuestionBoard(store, Overlap()).shown(RATER)[-1]
            pair = store.pair(shown.pair_id)
        scores = ClipScores(dataset.features, self._criterion)
        choice = better(*(float(scores(clip).mean()) for clip in (pair.a, pair.b)))
        side = "left" if choice == shown.shown_left else "right"
        key = _KEYS["equal" if choice == "equal" else side]
        while time.monotonic() < begin_s + self._look_s:
            page.wait_for_timeout(1000 * _LOOK_S)
        self._looking_s += time.monotonic() - begin_s
        if page.get_by_role("dialog").count():
            page.keyboard.press("Escape")
            page.get_by_role("dialog").wait_for(state="detached", timeout=_LOADED_MS)
        page.keyboard.press(key)
        self._answers += 1
        taken_s = time.monotonic() + 10.0
        while page.evaluate(_SHOWN) == question_id and time.monotonic() < taken_s:
            page.wait_for_timeout(1000 * _LOOK_S)


def share_of_true(criterion: str, earned: float) -> float | None:
    """Share of what PPO with the true reward gains from the same walk; None where no
    row of preferences knows that."""
    for row in read_rows(REFERENCES):
        if row["criterion"] == criterion and row.get("robot") is None:
            start, true = row["start_return"], row["true_return"]
            return (earned - start) / (true - start)
    return None


def _listens(port: int) -> bool:
    with socket.socket() as tried:
        return tried.connect_ex(("127.0.0.1", port)) == 0


def _figures(
    run: Path, cfg: LoopCfg, seen: _Seen, begin_s: float, total_s: float
) -> dict[str, Figure]:
    with Dataset.open(run / "dataset").answers() as store:
        rows = store.current_answers()
    kinds = Counter(
        "meanwhile"
        if pair.meanwhile is not None
        else "known"
        if pair.gold
        else "repeated"
        if answer.role == "repeat"
        else "asked"
        for pair, answer in rows
    )
    first, last = (read_json(Round(run, n).report) for n in (0, cfg.rounds))
    earned = last["evaluation"]["return_mean"]
    longest_s, doing = max(seen.waits_s, default=(0.0, ""))
    return {
        "minutes_to_verdict": total_s / 60,
        "waiting_share": 1.0 - seen.looking_s / total_s,
        "first_pair_s": seen.first_pair_s - begin_s,
        "answers_asked_by_rounds": kinds["asked"],
        "answers_meanwhile": kinds["meanwhile"],
        "answers_that_measure": kinds["known"] + kinds["repeated"],
        "answers_lost": seen.answers - len(rows),
        "longest_wait_s": longest_s,
        "longest_wait_while": doing,
        "next_pair_median_s": sorted(s for s, _ in seen.waits_s)[
            len(seen.waits_s) // 2
        ],
        "return_before": first["evaluation"]["return_mean"],
        "return_after": earned,
        "share_of_true": share_of_true(cfg.criterion, earned),
        "tracking_error_m_s": last["evaluation"]["tracking_error_m_s"],
        "verdict": last.get("verdict", {}).get("word"),
    }


if __name__ == "__main__":
    main(tyro.cli(Options))
