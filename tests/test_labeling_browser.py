"""The labeling page in a real browser.

Needs Chromium: `apt-get install chromium`, or any Chrome on the PATH.
"""

import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from benchmarks.walks import walking_dataset
from data.answers import Answer
from data.dataset import Dataset
from labeling_ui.server import LabelCfg, LabelServer
from labeling_ui.tokens import TokenStore

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

playwright = pytest.importorskip(
    "playwright.sync_api",
    reason="the browser tests need Playwright: pip install -e '.[dev]'",
)

ARTIFACTS = Path(__file__).parents[1] / ".artifacts"
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

Visit = Callable[[str], "Page"]


def chromium() -> str:
    """A Chromium on the PATH, or Playwright's own."""
    for name in ("chromium", "google-chrome", "google-chrome-stable"):
        if found := shutil.which(name):
            return found
    own = sorted(Path.home().glob(".cache/ms-playwright/chromium-*/*/chrome"))
    if not own:
        pytest.skip(
            "the browser tests need a Chromium: apt-get install chromium, or "
            "python -m playwright install chromium"
        )
    return str(own[-1])


@pytest.fixture(scope="module")
def browser() -> Iterator["Browser"]:
    """One headless Chromium for all tests."""
    with playwright.sync_playwright() as driver:
        found = driver.chromium.launch(executable_path=chromium(), args=FLAGS)
        yield found
        found.close()


class Site:
    """A running page, the tokens of two raters, and what was stored."""

    def __init__(self, root: Path, pairs: int) -> None:
        self.dataset: Dataset = walking_dataset(root, pairs=pairs)
        tokens = TokenStore(root)
        self.tokens = {name: tokens.add(name) for name in ("ann", "bob")}
        self.server = LabelServer(self.dataset, LabelCfg(port=0, shadows=False))

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

    def open_page(rater: str) -> "Page":
        context = browser.new_context(viewport={"width": 1280, "height": 720})
        context.set_default_timeout(WAIT_MS)
        contexts.append(context)
        page = context.new_page()
        context.request.post(
            site.server.url + "/login",
            form={"token": site.tokens[rater]},
            headers={"Origin": site.server.url},
        )
        # Few pixels: drawing them in software is what takes long.
        page.goto(site.server.url + "/?fixedDpr=0.2")
        page.get_by_role("button", name="A much better [1]").wait_for()
        return page

    yield open_page
    for context in contexts:
        context.close()


def dismiss_guidelines(page: "Page") -> None:
    """Close the dialog every new rater sees first."""
    page.get_by_role("dialog").wait_for()
    page.keyboard.press("Escape")
    page.get_by_role("dialog").wait_for(state="detached")


def counted(page: "Page", answered: int) -> None:
    """Wait until the page shows that many answers; then a pair can be judged."""
    page.get_by_text(re.compile(rf"\b{answered} answered")).wait_for()
    page.wait_for_timeout(700)


def test_an_hour_in_short(site: Site, visit: Visit) -> None:
    """Guidelines, key, button, key repeat, undo, reopen, note, bad clip, reload."""
    page = visit("ann")
    page.get_by_text("walks better.").first.wait_for()
    page.keyboard.press("1")
    page.wait_for_timeout(300)
    assert site.answers() == []  # A dialog was open.
    dismiss_guidelines(page)

    page.keyboard.press("2")
    counted(page, 1)
    assert site.answers()[0].target in (0.25, 0.75)
    page.get_by_role("button", name="B much better [5]").click()
    counted(page, 2)
    for _ in range(12):
        page.keyboard.down("3")
        page.wait_for_timeout(30)
    page.keyboard.up("3")
    counted(page, 3)
    assert len(site.answers()) == 3  # Auto-repeat is one answer.

    page.keyboard.press("z")
    counted(page, 2)
    page.get_by_role("button", name="Undo [Z]").click()
    counted(page, 1)

    note = page.locator("textarea").first
    note.fill("B drags 1 foot 5 times")
    page.wait_for_timeout(300)
    assert len(site.answers()) == 1  # Digits in a note are text.
    page.locator("canvas[data-engine]").click(position={"x": 60, "y": 60})
    page.keyboard.press("4")
    counted(page, 2)
    assert site.answers()[0].note == "B drags 1 foot 5 times"
    assert note.input_value() == ""

    page.get_by_role("button", name="Bad clip [F]").click()
    page.get_by_role("button", name="Too short to judge").click()
    counted(page, 3)
    newest = site.answers()[0]
    assert (newest.choice, newest.reason) == ("bad", "Too short to judge")

    page.reload()
    counted(page, 3)
    page.get_by_text("Last answers").click()
    page.get_by_role("button", name=re.compile("Bad clip$")).first.click()
    page.get_by_text(re.compile("Reopened: you said")).wait_for()
    page.wait_for_timeout(1200)
    page.keyboard.press("3")
    page.get_by_text(re.compile("Reopened")).wait_for(state="detached")
    page.wait_for_timeout(300)
    assert site.answers()[0].supersedes == newest.answer_id
    assert len(site.answers()) == 3

    page.keyboard.press("h")
    page.get_by_role("dialog").wait_for()
    page.keyboard.press("Escape")
    ARTIFACTS.mkdir(exist_ok=True)
    picture = ARTIFACTS / "labeling-page.png"
    page.screenshot(path=picture)
    assert picture.stat().st_size > 20_000


def test_two_raters_are_asked_different_things(site: Site, visit: Visit) -> None:
    """Each has an own queue and history, and a pair shown to one is leased."""
    ann, bob = visit("ann"), visit("bob")
    dismiss_guidelines(ann)
    dismiss_guidelines(bob)
    ann.wait_for_timeout(500)
    ann.keyboard.press("1")
    counted(ann, 1)
    bob.keyboard.press("5")
    counted(bob, 1)
    (first,), (second,) = site.answers("ann"), site.answers("bob")
    assert first.pair_id != second.pair_id


def test_with_nothing_open_it_waits_for_pairs(
    browser: "Browser", tmp_path: Path
) -> None:
    """It says what to do, and goes on by itself; here without a login."""
    empty = walking_dataset(tmp_path / "set", pairs=0)
    with LabelServer(empty, LabelCfg(port=0, auth=False, shadows=False)) as server:
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        page.set_default_timeout(WAIT_MS)
        page.goto(server.url + "/?fixedDpr=0.2")
        page.get_by_text("No open pairs.").wait_for()
        dismiss_guidelines(page)
        walking_dataset(tmp_path / "set", pairs=2)
        page.get_by_text("Which one walks better?").wait_for()
        counted(page, 0)
        page.keyboard.press("3")
        counted(page, 1)
        page.close()


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
