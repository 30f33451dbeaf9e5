"""The labeling page in a real browser: any Chromium or Chrome that is found.

Two busy cores draw WebGL in software at a frame a second or less, so nothing here waits
for a fixed time, and nothing depends on how long something takes.
"""

import os
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from benchmarks.walks import walking_dataset
from data.answers.answer_records import Answer
from data.datasets.dataset import Dataset
from labeling_ui.label_server import LabelCfg, LabelServer
from labeling_ui.questions.key_repeat import GuardCfg
from labeling_ui.questions.rater_session import QueueCfg
from labeling_ui.web.tokens import TokenStore

pytestmark = pytest.mark.browser

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Playwright, ViewportSize

playwright = pytest.importorskip(
    "playwright.sync_api",
    reason="the browser tests need Playwright: pip install -e '.[dev]'",
)

ARTIFACTS = Path(__file__).parents[2] / ".artifacts"
WAIT_MS = 90_000
"""For anything to appear: two busy cores draw WebGL in software."""
FLAGS = (
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)

LAPTOP: "ViewportSize" = {"width": 1280, "height": 720}
SMALL: "ViewportSize" = {"width": 800, "height": 450}
"""Where two windows have to be drawn at once."""

Visit = Callable[..., "Page"]


def chromium(driver: "Playwright") -> str:
    """A Chromium on the PATH, or Playwright's own; without one there are no tests."""
    for name in ("chromium", "chromium-browser", "google-chrome", "chrome"):
        if found := shutil.which(name):
            return found
    own = driver.chromium.executable_path
    if not Path(own).exists():
        message = (
            "the browser tests need a Chromium: apt-get install chromium, or "
            "python -m playwright install chromium"
        )
        if os.environ.get("CI"):
            pytest.fail(message)
        pytest.skip(message)
    return own


@pytest.fixture(scope="module")
def browser() -> Iterator["Browser"]:
    """One headless Chromium for all tests."""
    with playwright.sync_playwright() as driver:
        found = driver.chromium.launch(executable_path=chromium(driver), args=FLAGS)
        yield found
        found.close()


GUARD = GuardCfg(min_shown_s=0.0, repeat_gap_s=10.0, same_verdict_s=10.0)
"""A pair may be judged at once; the same verdict again within ten seconds is a held key
or a double click, however slowly a busy browser sends it."""


def label_cfg(*, auth: bool = True) -> LabelCfg:
    """A page on a free port, cheap to draw."""
    queue = QueueCfg(guard=GUARD)
    return LabelCfg(port=0, auth=auth, shadows=False, queue=queue)


class Site:
    """A running page, the tokens of two raters, and what was stored."""

    def __init__(self, root: Path, pairs: int) -> None:
        self.dataset: Dataset = walking_dataset(root, pairs=pairs)
        tokens = TokenStore(root)
        self.tokens = {name: tokens.add(name) for name in ("ann", "bob")}
        self.server = LabelServer(self.dataset, label_cfg())

    def answers(self, rater: str = "ann") -> list[Answer]:
        """Current answers of a rater, newest first."""
        with self.dataset.answers() as store:
            return [answer for _, answer in store.history(rater, 100)]


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    """A page with twelve open pairs."""
    site = Site(tmp_path / "set", pairs=12)
    with site.server:
        yield site


@pytest.fixture
def visit(browser: "Browser", site: Site) -> Iterator[Visit]:
    """Log in as somebody and wait for the page."""
    contexts = []

    def open_page(rater: str, size: "ViewportSize" = LAPTOP) -> "Page":
        context = browser.new_context(viewport=size)
        context.set_default_timeout(WAIT_MS)
        contexts.append(context)
        page = context.new_page()
        context.request.post(
            site.server.url + "/login",
            form={"token": site.tokens[rater]},
            headers={"Origin": site.server.url},
        )
        # Few pixels: drawing them in software is what takes long.
        page.goto(site.server.url + "/?fixedDpr=0.1")
        page.get_by_role("button", name="A much better [1]").wait_for()
        return page

    yield open_page
    for context in contexts:
        context.close()


def dismiss_guidelines(page: "Page") -> None:
    """Close the dialog every new rater sees first."""
    page.bring_to_front()
    page.get_by_role("button", name="Got it [escape]").click()
    page.get_by_role("dialog").wait_for(state="detached")


def counted(page: "Page", answered: int) -> None:
    """Wait until the page shows that many answers."""
    page.get_by_text(re.compile(rf"\b{answered} answered")).wait_for()


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
    page.get_by_role("textbox").and_(page.get_by_label("you are")).or_(
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


def keep_picture(page: "Page", name: str) -> None:
    """Leave a screenshot for people; nearly empty ones are small."""
    ARTIFACTS.mkdir(exist_ok=True)
    page.screenshot(path=ARTIFACTS / name)
    assert (ARTIFACTS / name).stat().st_size > 20_000


def test_two_raters_are_asked_different_things(site: Site, visit: Visit) -> None:
    """Each has an own queue and history, and a pair shown to one is leased."""
    pages = [visit(name, SMALL) for name in ("ann", "bob")]
    for page, key in zip(pages, "15", strict=True):
        # Only the tab in front gets keys.
        dismiss_guidelines(page)
        page.keyboard.press(key)
        counted(page, 1)
    (first,), (second,) = site.answers("ann"), site.answers("bob")
    assert first.pair_id != second.pair_id


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
        page.keyboard.press("3")
        counted(page, 1)
        page.close()
