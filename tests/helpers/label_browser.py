"""The labeling page in a real browser: any Chromium or Chrome that is found.

Two busy cores draw WebGL in software at a frame a second or less, so nothing here waits
for a fixed time, and nothing depends on how long something takes.
"""

import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from benchmarks.walks import AHEAD, walking_dataset
from data.answers.answer_records import Answer
from data.datasets.dataset import Dataset
from labeling_ui.label_server import LabelCfg, LabelServer
from labeling_ui.questions.key_repeat import GuardCfg
from labeling_ui.questions.rater_session import QueueCfg
from labeling_ui.web.tokens import TokenStore

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


@contextmanager
def launched() -> Iterator["Browser"]:
    """A headless Chromium."""
    with playwright.sync_playwright() as driver:
        found = driver.chromium.launch(executable_path=chromium(driver), args=FLAGS)
        yield found
        found.close()


GUARD = GuardCfg(min_shown_s=0.0, repeat_gap_s=10.0, same_verdict_s=10.0)
"""A pair may be judged at once; the same verdict again within ten seconds is a held key
or a double click, however slowly a busy browser sends it."""


def label_cfg(*, guard: GuardCfg = GUARD, **cfg: Any) -> LabelCfg:
    """A page on a free port, cheap to draw."""
    cfg.setdefault("port", 0)
    return LabelCfg(shadows=False, queue=QueueCfg(guard=guard), **cfg)


class Site:
    """A running page, the tokens of two raters, and what was stored."""

    def __init__(
        self,
        root: Path,
        pairs: int,
        *,
        command: tuple[float, float, float] = AHEAD,
        **cfg: Any,
    ) -> None:
        self.dataset: Dataset = walking_dataset(root, pairs=pairs, command=command)
        tokens = TokenStore(root)
        self.tokens = {name: tokens.add(name) for name in ("ann", "bob")}
        self.server = LabelServer(self.dataset, label_cfg(**cfg))

    def answers(self, rater: str = "ann") -> list[Answer]:
        """Current answers of a rater, newest first."""
        with self.dataset.answers() as store:
            return [answer for _, answer in store.history(rater, 100)]


def opened(
    browser: "Browser",
    site: Site,
    rater: str,
    *,
    size: "ViewportSize" = LAPTOP,
    url: str = "",
    clock: bool = False,
    **context: Any,
) -> "Page":
    """The page of a rater who logs in; close its context afterwards.

    Args:
        url: Where the page is, if something stands before the server.
        clock: Let the test turn the page's clock on.
    """
    address = url or site.server.url
    own = browser.new_context(viewport=size, **context)
    own.set_default_timeout(WAIT_MS)
    page = own.new_page()
    if clock:
        page.clock.install()
    own.request.post(
        address + "/login",
        form={"token": site.tokens[rater]},
        headers={"Origin": address},
    )
    # Few pixels: drawing them in software is what takes long.
    page.goto(address + "/?fixedDpr=0.1")
    page.get_by_role("button", name="A much better [1]").wait_for()
    return page


def dismiss_guidelines(page: "Page") -> None:
    """Close the dialog every new rater sees first."""
    page.bring_to_front()
    page.get_by_role("button", name="Got it [escape]").click()
    page.get_by_role("dialog").wait_for(state="detached")


def nothing_of_viser(page: "Page") -> None:
    """No server's address, no settings of the scene: what only its makers need."""
    for word in ("Server", "Save Canvas", "Orbit Origin Tool", "Reset View"):
        assert not page.get_by_text(word, exact=True).first.is_visible(), word
    assert not page.locator(".tabler-icon-adjustments").first.is_visible()


def counted(page: "Page", answered: int) -> None:
    """Wait until the page shows that many answers."""
    page.get_by_text(re.compile(rf"\b{answered} answered")).wait_for()


def keep_picture(page: "Page", name: str) -> None:
    """Leave a screenshot for people; nearly empty ones are small."""
    ARTIFACTS.mkdir(exist_ok=True)
    page.screenshot(path=ARTIFACTS / name)
    assert (ARTIFACTS / name).stat().st_size > 20_000
