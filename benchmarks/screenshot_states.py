"""What people meet on the labeling page beside a question, as pictures of one size."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

from data.datasets.dataset import Dataset
from labeling_ui.label_server import LabelCfg, LabelServer

from .camera import SETTLE_MS, THEMES, Camera, Theme, log_in, opened, page_of

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Route

Serve = Callable[[], AbstractContextManager[tuple[LabelServer, str]]]
"""Serves pairs, and gives the token of a rater."""


def take_states(browser: Browser, camera: Camera, serve: Serve, folder: Path) -> None:
    """The map of the keys, what the last pair differed in, a lost connection, a page
    that loads, and nothing to ask."""
    for theme in THEMES:
        with page_of(browser) as page:
            with serve() as (server, token):
                log_in(page, server.url, token)
                opened(page, server.url)
                _dialogs(page, camera, theme)
                url = f"{server.url}/"
                sent = page.request.get(url).body()
            page.locator('html[data-gp="lost"]').wait_for(state="attached")
            camera.take(page, "connection-lost", theme)
        if theme == "light":
            # Which theme a rater likes is known once the page is there.
            with page_of(browser) as page:
                _answer_with(page, url, sent)
                page.goto(url)
                page.wait_for_timeout(SETTLE_MS)
                camera.take(page, "loading", theme)
    dataset = Dataset.create(folder / "nothing")
    with (
        LabelServer(dataset, LabelCfg(port=0, auth=False)) as server,
        page_of(browser) as page,
    ):
        opened(page, server.url)
        for theme in THEMES:
            _in(page, theme)
            camera.take(page, "no-open-pairs", theme)


def _dialogs(page: Page, camera: Camera, theme: Theme) -> None:
    _in(page, theme)
    page.keyboard.press("?")
    page.get_by_role("dialog", name="Keys").wait_for()
    camera.take(page, "keys", theme)
    page.keyboard.press("Escape")
    page.keyboard.press("2")
    page.get_by_text("Which one walks better?").wait_for()
    page.wait_for_timeout(SETTLE_MS)
    page.keyboard.press("6")
    page.get_by_text("Go on [escape]").wait_for()
    page.wait_for_timeout(SETTLE_MS)
    camera.take(page, "differed", theme)
    page.keyboard.press("Escape")


def _answer_with(page: Page, url: str, sent: bytes) -> None:
    """Have the window get the page of a server that is gone."""

    def fulfil(route: Route) -> None:
        route.fulfill(body=sent, content_type="text/html")

    page.route(url, fulfil)


def _in(page: Page, theme: Theme) -> None:
    if theme == "dark":
        page.keyboard.press("m")
        page.wait_for_timeout(SETTLE_MS)
