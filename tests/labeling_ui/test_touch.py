"""What a finger reaches: a tablet and a phone, of one rater, test after test."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from tests.helpers.label_browser import (
    WAIT_MS,
    Site,
    dismiss_guidelines,
    keep_picture,
    launched,
    opened,
    playwright,
)

if TYPE_CHECKING:
    from playwright.sync_api import Page, ViewportSize, expect
else:
    expect = playwright.expect

pytestmark = pytest.mark.browser
TABLET: ViewportSize = {"width": 1024, "height": 768}


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """A page without a mouse, its guidelines read."""
    site = Site(tmp_path_factory.mktemp("touch") / "set", pairs=6)
    with site.server, launched() as browser:
        page = opened(browser, site, "ann", size=TABLET, has_touch=True)
        dismiss_guidelines(page)
        yield page
        page.context.close()


def test_a_tablet_reaches_plots_and_ghost(page: Page) -> None:
    """By buttons, as nobody presses a key there."""
    assert not page.locator("#gp-taps").is_visible()
    ghost = page.locator('[data-scene-node="/ghost_A"]')
    assert ghost.count() == 0
    page.get_by_text("View and help").tap()
    page.get_by_role("button", name="Ghost of the other clip [V]").tap()
    ghost.first.wait_for(state="attached")
    plots = page.get_by_role("button", name="Plots [P]")
    plots.tap()
    page.get_by_text("base height, m").wait_for()
    plots.tap()
    page.get_by_text("base height, m").wait_for(state="hidden")


@pytest.mark.parametrize(("width", "height"), [(390, 844), (844, 390)])
def test_a_phone_pauses_and_replays(page: Page, width: int, height: int) -> None:
    """By buttons over the scene; a dialog guards them as it guards keys."""
    page.set_viewport_size({"width": width, "height": height})
    scene = page.locator("#root canvas[data-engine]")
    side, length = (
        ("clientWidth", width) if height > width else ("clientHeight", height)
    )
    expect(scene).to_have_js_property(side, length, timeout=WAIT_MS)
    speed = page.locator(".gp .speed")
    pause = page.get_by_role("button", name="Play or pause", exact=True)
    replay = page.get_by_role("button", name="Replay", exact=True)
    pause.tap()
    expect(speed).to_have_text("1x paused", timeout=WAIT_MS)
    replay.tap()
    expect(speed).to_have_text("1x", timeout=WAIT_MS)
    page.get_by_role("button", name="Bad clip [F]").tap()
    page.get_by_role("dialog").get_by_text("Too short").wait_for()
    page.evaluate("document.querySelector('[data-gp-press=space]').click()")
    page.keyboard.press("Escape")
    page.get_by_role("dialog").wait_for(state="detached")
    expect(speed).to_have_text("1x")
    picture = scene.bounding_box()
    assert picture is not None
    for button in (pause, replay):
        found = button.bounding_box()
        assert found is not None
        assert found["height"] >= 44
        assert found["y"] + found["height"] <= picture["y"] + picture["height"]
    assert not page.get_by_role("button", name="Plots [P]").is_visible()
    keep_picture(page, f"phone-{width}.png")
