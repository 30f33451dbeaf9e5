"""What a rater sees when the line is cut, the server restarts, or a laptop slept.

How long something takes is measured where the page promises it, with room for a machine
that is busy with other things.
"""

import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from labeling_ui.label_server import LabelServer
from labeling_ui.limits import page_limits
from labeling_ui.page.remarks import Marks, marks_of
from labeling_ui.page.view_habits import Habits, habits_of
from labeling_ui.questions.key_repeat import GuardCfg
from tests.helpers.contrast import contrasts, require_readable_cover, too_pale
from tests.helpers.label_browser import (
    SMALL,
    WAIT_MS,
    Site,
    counted,
    dismiss_guidelines,
    label_cfg,
    launched,
    nothing_of_viser,
    opened,
    playwright,
)
from tests.helpers.waiting import wait_for
from tests.helpers.wire import Wire

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, expect
else:
    expect = playwright.expect

pytestmark = pytest.mark.browser

NOTE = "B drags a foot"
SAID = re.compile("^Because of feet(, marked .*)?: now answer")
COVERED = """() => {
  const cover = document.getElementById("gp-cover");
  const shares = [0.02, 0.25, 0.5, 0.75, 0.98];
  return getComputedStyle(cover).opacity === "1"
    && /^rgb\\(/.test(getComputedStyle(cover).backgroundColor)
    && shares.every((x) => shares.every((y) => cover.contains(
      document.elementFromPoint(x * innerWidth, y * innerHeight))));
}"""
"""Whether what is behind the cover shows nowhere."""
COUNT_PROGRAMS = """() => {
  const context = WebGL2RenderingContext.prototype, link = context.linkProgram;
  window.programs = 0;
  context.linkProgram = function(program) {
    window.programs += 1;
    link.call(this, program);
  };
}"""
"""Counts what is built to draw with; without a graphics card each may take seconds."""
BACK_S = 5.0
"""What the page promises, once the server is there again."""
SLOWER = 4.0
"""A machine that draws in software and does other things besides."""


@pytest.fixture(scope="module")
def browser() -> Iterator["Browser"]:
    """One for all tests."""
    with launched() as found:
        yield found


@contextmanager
def at_work(
    browser: "Browser", root: Path, **cfg: Any
) -> Iterator[tuple[Site, Wire, "Page"]]:
    """A rater's page, whose guidelines were read, behind a line."""
    any_time = GuardCfg(min_shown_s=0.0, repeat_gap_s=0.0, same_verdict_s=0.0)
    site = Site(root / "set", pairs=6, guard=any_time, **cfg)
    site.server.start()
    wire = Wire(int(site.server.url.rpartition(":")[2]))
    page = opened(browser, site, "ann", size=SMALL, url=wire.url, clock=True)
    dismiss_guidelines(page)
    try:
        yield site, wire, page
    finally:
        page.context.close()
        wire.cut()
        site.server.stop()


def state(page: "Page", name: str) -> None:
    """Wait until the page is `lost`, `loading`, `away` or, as usual, nothing of it."""
    page.locator(f'html[data-gp="{name}"]').wait_for(state="attached")


def remark(page: "Page") -> None:
    """Say all that can be said before an answer, and go on writing."""
    page.keyboard.press("8")
    page.keyboard.press("b")
    page.get_by_text(SAID).wait_for()
    page.locator("#root textarea").click()
    page.keyboard.type(NOTE)


def test_after_an_outage_it_goes_on_where_it_was(
    browser: "Browser", tmp_path: Path
) -> None:
    """It says so, stops its clock, and keeps what was written, before and meanwhile; a
    key pressed meanwhile is told as not stored. Ten minutes pass in a moment."""
    with at_work(browser, tmp_path) as (site, wire, page):
        page.keyboard.press("x")
        page.get_by_text("Marked").first.wait_for()
        remark(page)
        asked = page.locator("[data-gp-question]").get_attribute("data-gp-question")
        page.evaluate(COUNT_PROGRAMS)
        wire.cut()
        state(page, "lost")
        page.get_by_role("heading", name="Connection lost").wait_for()
        nothing_of_viser(page)
        require_readable_cover(page)
        running = page.locator(".gp .head").evaluate(
            "head => getComputedStyle(head).animationPlayState"
        )
        assert running == "paused"
        page.keyboard.type(" and slips")
        page.keyboard.press("Escape")
        page.keyboard.press("2")
        page.get_by_text("Not stored, as there was no connection: A better").wait_for()
        for _ in range(10):
            page.clock.fast_forward(60_000)
        wire.join()
        joined_s = time.monotonic()
        state(page, "")
        assert time.monotonic() - joined_s < SLOWER * BACK_S
        assert page.evaluate("window.programs") == 0
        page.get_by_text("The connection is back. Not stored").wait_for()
        page.locator("input[value='fairly sure [8]']").first.wait_for()
        page.get_by_text(
            re.compile("^Because of feet, marked .*: now answer")
        ).wait_for()
        now = page.locator("[data-gp-question]").get_attribute("data-gp-question")
        assert now == asked
        assert site.answers() == []
        page.keyboard.press("4")
        counted(page, 1)
        (answer,) = site.answers()
        assert answer.note == NOTE + " and slips"
        assert (answer.confidence, answer.why) == (0.6, "feet")
        assert len(answer.here_s) == 1


def test_a_line_that_died_while_the_laptop_slept(
    browser: "Browser", tmp_path: Path
) -> None:
    """No end of it is heard of: the page finds out, and opens another."""
    with at_work(browser, tmp_path) as (_, wire, page):
        wire.deaden()
        page.clock.fast_forward(60_000)
        state(page, "lost")
        state(page, "")
        page.keyboard.press("4")
        counted(page, 1)


def test_a_server_that_was_restarted(browser: "Browser", tmp_path: Path) -> None:
    """As when a loop goes on: another process, the same answers; and what was written
    is there, with the cursor in it. No guidelines a second time."""
    with at_work(browser, tmp_path) as (site, _, page):
        page.keyboard.press("x")
        remark(page)
        wait_for(lambda: "gp-here" in page.evaluate("document.cookie"))
        port = int(site.server.url.rpartition(":")[2])
        site.server.stop()
        state(page, "lost")
        site.server = LabelServer(site.dataset, label_cfg(port=port))
        site.server.start()
        state(page, "")
        expect(page.locator("textarea:focus")).to_have_value(NOTE, timeout=WAIT_MS)
        page.keyboard.type("!")
        expect(page.locator("textarea:focus")).to_have_value(NOTE + "!")
        page.get_by_text(
            re.compile("^Because of feet, marked .*: now answer")
        ).wait_for()
        assert page.get_by_role("dialog").count() == 0


def test_how_a_rater_likes_to_look_is_kept(browser: "Browser", tmp_path: Path) -> None:
    """Theme, view, speed, ghost and plots, over a lost line and another server."""
    chosen = "lanes-0.5x-dark-ghost-curves"
    with at_work(browser, tmp_path) as (site, wire, page):
        told = page.locator("[data-gp-habits]")
        for key in "mtvpuu":
            page.keyboard.press(key)
        page.keyboard.press("i")
        expect(told).to_have_attribute("data-gp-habits", chosen, timeout=WAIT_MS)
        wait_for(lambda: "curves" in page.evaluate("document.cookie"))
        for server_too in (False, True):
            wire.cut()
            state(page, "lost")
            if server_too:
                port = int(site.server.url.rpartition(":")[2])
                site.server.stop()
                site.server = LabelServer(site.dataset, label_cfg(port=port))
                site.server.start()
            wire.join()
            state(page, "")
            expect(told).to_have_attribute("data-gp-habits", chosen)
            root = page.locator("html")
            expect(root).to_have_attribute("data-mantine-color-scheme", "dark")
            page.get_by_text("base height, m").wait_for()
            page.locator(".gp .speed").get_by_text("0.5x", exact=True).wait_for()
            ghost = page.locator('[data-scene-node="/ghost_A"]')
            ghost.first.wait_for(state="attached")
            page.locator('[data-scene-node="/lanes"]').first.wait_for(state="attached")


def test_a_browser_may_send_any_habits() -> None:
    """What is none is passed over."""
    assert habits_of("") == habits_of("-3x-DARK-<b>;\0-nan-1e9x") == Habits()
    chosen = Habits(dark=True, view="lanes", speed=0.25, ghost=True, curves=True)
    assert habits_of(chosen.text) == chosen
    assert marks_of("").here_s == marks_of("q_nan_-1.00_<b>_1e9_123.45_1").here_s == ()
    marked = Marks(question_id="q", here_s=(0.3, 1.25))
    assert marks_of(marked.text) == marked
    assert len(marks_of("_".join(["q", *(f"{n}.00" for n in range(20))])).here_s) == 8


def test_who_finds_no_place_is_told_and_let_in(
    browser: "Browser", tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another took it during an outage, and leaves again."""
    monkeypatch.setattr(page_limits, "FULL_S", 1.0)
    with at_work(browser, tmp_path, most_raters=1) as (site, wire, page):
        wire.cut()
        state(page, "lost")
        other = opened(browser, site, "bob", size=SMALL)
        wire.join()
        page.get_by_role("heading", name="The only place is taken").wait_for()
        for theme in ("light", "dark"):
            page.emulate_media(color_scheme=theme)
            # The page asks again and again.
            page.get_by_role("heading", name="The only place is taken").wait_for()
            found = contrasts(page)
            assert len(found) >= 3
            assert too_pale(found) == {}
        other.context.close()
        page.get_by_role("button", name="A much better [1]").wait_for()
        state(page, "")


def test_only_the_newest_window_answers(browser: "Browser", tmp_path: Path) -> None:
    """The other says so, and takes the place back when it is told to. While one loads,
    it shows this alone."""
    with at_work(browser, tmp_path) as (_, wire, page):
        wire.holds_sockets = True
        newer = page.context.new_page()
        newer.goto(page.url)
        state(newer, "loading")
        newer.get_by_text("The page is loading. On a slow line").wait_for()
        newer.locator("#root > *").first.wait_for(state="attached")
        assert newer.evaluate(COVERED)
        require_readable_cover(newer)
        wire.holds_sockets = False
        state(newer, "")
        nothing_of_viser(newer)
        page.bring_to_front()
        state(page, "away")
        require_readable_cover(page, least=3)
        page.get_by_role("button", name="Go on here").click()
        state(page, "")
        newer.bring_to_front()
        state(newer, "away")
