"""A rater's work in a real browser."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from benchmarks.walks import walking_dataset
from labeling_ui.label_server import LabelServer
from tests.helpers.label_browser import (
    LAPTOP,
    SMALL,
    WAIT_MS,
    Site,
    counted,
    dismiss_guidelines,
    keep_picture,
    label_cfg,
    launched,
    opened,
)

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, ViewportSize

pytestmark = pytest.mark.browser
Visit = Callable[..., "Page"]


@pytest.fixture(scope="module")
def browser() -> Iterator["Browser"]:
    """One for all tests."""
    with launched() as found:
        yield found


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    """A page with twelve open pairs."""
    site = Site(tmp_path / "set", pairs=12)
    with site.server:
        yield site


@pytest.fixture
def visit(browser: "Browser", site: Site) -> Iterator[Visit]:
    """Log in as somebody and wait for the page."""
    pages = []

    def open_page(rater: str, size: "ViewportSize" = LAPTOP) -> "Page":
        pages.append(opened(browser, site, rater, size=size))
        return pages[-1]

    yield open_page
    for page in pages:
        page.context.close()


def test_only_a_token_leads_to_the_page(browser: "Browser", site: Site) -> None:
    """A wrong one leads back to the login, the right one to the page."""
    context = browser.new_context()
    context.set_default_timeout(WAIT_MS)
    page = context.new_page()
    page.goto(site.server.url)
    for token, path in (("wrong", "/login"), (site.tokens["ann"], "/")):
        page.locator("input[type=password]").fill(token)
        page.keyboard.press("Enter")
        page.wait_for_url(site.server.url + path, wait_until="commit")
    context.close()


def test_a_rater_at_work(site: Site, visit: Visit) -> None:
    """Guidelines, keys, buttons, undo, note, bad clip, reload, reopen.

    Events arrive in the order they were made: what must not have been an answer is
    looked for after the next thing that shows on the page.
    """
    page = visit("ann")
    page.get_by_text("walks better, or").first.wait_for()
    page.keyboard.press("1")
    dismiss_guidelines(page)
    assert site.answers() == []  # A dialog was open.

    page.keyboard.press("2")
    counted(page, 1)
    assert site.answers()[0].target in (0.25, 0.75)
    page.get_by_role("button", name="B much better [5]").dblclick()
    counted(page, 2)
    for _ in range(12):
        page.keyboard.down("3")
    page.keyboard.up("3")
    counted(page, 3)
    page.keyboard.press("0")
    counted(page, 4)
    # Neither the second click nor the repeats of the key were answers.
    assert [answer.choice for answer in site.answers()][:2] == ["skip", "equal"]
    assert len(site.answers()) == 4

    page.keyboard.press("z")
    counted(page, 3)
    page.get_by_role("button", name="Undo [Z]").click()
    counted(page, 2)

    note = page.locator("textarea").first
    note.click()
    page.keyboard.type("B drags 1 foot 5 times")
    page.locator("canvas[data-engine]").click(position={"x": 480, "y": 120})
    page.keyboard.press("9")
    page.get_by_role("textbox").and_(page.get_by_label("how sure")).or_(
        page.locator("input[value='sure [9]']")
    ).first.wait_for()
    page.get_by_role("button", name="feet [B]").click()
    page.get_by_text("Because of feet: now answer").wait_for()
    page.keyboard.press("y")
    page.get_by_text("Because of rhythm: now answer").wait_for()
    page.keyboard.press("4")
    counted(page, 3)
    page.get_by_text(": now answer").wait_for(state="hidden")
    noted = site.answers()[0]
    assert [answer.why for answer in site.answers()] == ["rhythm", "", ""]
    assert (noted.note, noted.confidence) == ("B drags 1 foot 5 times", 0.95)
    assert len(site.answers()) == 3  # Digits in a note are text.
    assert note.input_value() == ""

    page.get_by_role("button", name="Bad clip [F]").click()
    page.get_by_role("button", name="Too short to judge").click()
    counted(page, 4)
    newest = site.answers()[0]
    assert (newest.choice, newest.reason) == ("bad", "Too short to judge")

    page.keyboard.press("f")
    page.get_by_role("button", name="Both walk badly").wait_for()
    page.keyboard.press("5")
    counted(page, 5)
    both = site.answers()[0]
    assert (both.choice, both.reason) == ("equal", "Both walk badly, neither better")
    page.keyboard.press("z")
    counted(page, 4)

    page.reload()
    counted(page, 4)
    page.get_by_text("Last answers").click()
    page.get_by_role("button", name=re.compile("Bad clip$")).first.click()
    page.get_by_text(re.compile("Reopened: you said")).wait_for()
    page.keyboard.press("1")
    page.get_by_text(re.compile("Reopened")).wait_for(state="detached")
    assert site.answers()[0].supersedes == newest.answer_id
    assert len(site.answers()) == 4

    page.keyboard.press("h")
    page.get_by_role("dialog").wait_for()
    page.keyboard.press("Escape")
    page.get_by_role("dialog").wait_for(state="detached")
    keep_picture(page, "labeling-page.png")


def test_with_nothing_open_it_waits_for_pairs(
    browser: "Browser", tmp_path: Path
) -> None:
    """It says what to do, and goes on by itself; here without a login."""
    empty = walking_dataset(tmp_path / "set", pairs=0)
    with LabelServer(empty, label_cfg(auth=False)) as server:
        page = browser.new_page(viewport=SMALL)
        page.set_default_timeout(WAIT_MS)
        page.goto(server.url + "/?fixedDpr=0.1")
        page.get_by_text("No open pairs.").wait_for()
        dismiss_guidelines(page)
        walking_dataset(tmp_path / "set", pairs=2)
        page.get_by_text("Which one walks better?").wait_for()
        head = page.locator("[data-gp-ready]")
        head.get_by_text("you", exact=True).wait_for()
        assert "local" not in (head.text_content() or "")
        assert "local" not in page.request.get(server.url + "/figures").text()
        page.keyboard.press("3")
        counted(page, 1)
        page.close()
