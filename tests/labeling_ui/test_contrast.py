"""Whether what stands on the pages beside the labeling page can be read."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import pytest

from benchmarks.walks import DT_S, ROBOT_XML, walk
from labeling_ui.play_server import PlayPage, play_site
from labeling_ui.scene.geometry import robot_geometry
from labeling_ui.scene.live_robot import Drive, LivePolicy, LiveState, StepFn
from labeling_ui.web.tokens import TokenStore
from tests.helpers.contrast import contrasts, require_readable_cover, too_pale
from tests.helpers.label_browser import (
    SMALL,
    WAIT_MS,
    Site,
    keep_picture,
    launched,
    nothing_of_viser,
    playwright,
)

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, expect
else:
    expect = playwright.expect

pytestmark = pytest.mark.browser
Theme = Literal["light", "dark"]
GAMEPAD = """() => {
  const buttons = Array.from({ length: 17 }, () => ({ pressed: false, value: 0 }));
  window.gamepad = { connected: true, axes: [0, 0, 0, 0], buttons };
  navigator.getGamepads = () => [null, gamepad];
  window.dispatchEvent(new Event("gamepadconnected"));
}"""
both_themes = pytest.mark.parametrize("theme", ["light", "dark"])


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One for all tests."""
    with launched() as found:
        yield found


def replayed(name: str, told: list[Drive] | None = None) -> LivePolicy:
    """A robot that trots as it was written down, whatever it is `told`."""
    episode = walk(100, seed=0)

    def new_step() -> StepFn:
        moments = iter(np.arange(10**6) % len(episode.action))

        def step(drive: Drive) -> LiveState:
            if told is not None:
                told.append(drive)
            qpos = episode.qpos[next(moments)]
            return LiveState(qpos, np.ones(4), 0.5, qpos[2], fallen=False)

        return step

    return LivePolicy(name, robot_geometry(ROBOT_XML.read_text()), DT_S, new_step)


def steer_by_gamepad(page: Page, told: list[Drive], liked: list[int]) -> None:
    """One that is not there: a stick that is held steers on and on as its key would, a
    button that is held is pressed once, and a stick at rest is nothing."""

    def until(held: Callable[[], bool]) -> None:
        before_s = time.monotonic() + WAIT_MS / 1000
        while not held():
            assert time.monotonic() < before_s
            page.wait_for_timeout(20)

    page.evaluate(GAMEPAD)
    assert told[-1].command == (0.5, 0.0, 0.0)
    page.evaluate("gamepad.axes[0] = 0.2; gamepad.axes[1] = -1")
    until(lambda: told[-1].command[0] >= 0.8)
    assert told[-1].command[2] == 0.0
    page.evaluate("gamepad.axes[1] = 0; gamepad.axes[0] = 1")
    until(lambda: told[-1].command[2] <= -0.4)
    page.evaluate("gamepad.axes[0] = 0; gamepad.buttons[1].pressed = true")
    until(lambda: told[-1].command == (0.0, 0.0, 0.0))
    page.evaluate("gamepad.buttons[1].pressed = false")
    page.evaluate("gamepad.buttons[5].pressed = true")
    until(lambda: bool(liked))
    page.wait_for_timeout(400)
    page.evaluate("gamepad.buttons[5].pressed = false")
    assert liked == [1]


def test_the_page_of_play(browser: Browser, tmp_path: Path) -> None:
    """With its buttons for what is liked, light and dark; and once its server ended.
    Keys or a gamepad drive it."""
    told: list[Drive] = []
    liked: list[int] = []

    def like(steps: Sequence[StepFn], number: int) -> str:
        del steps
        liked.append(number)
        return "kept"

    policies = (replayed("one", told), replayed("other"))
    site = play_site(0, TokenStore(tmp_path), likes=True)
    site.start(lambda client, visit: PlayPage(client, policies, like))
    found = {}
    with ExitStack() as running:
        running.callback(site.stop)
        page = browser.new_page(viewport=SMALL)
        page.set_default_timeout(WAIT_MS)
        page.goto(site.url + "/?fixedDpr=0.1")
        page.get_by_role("button", name="B walks as it should [2]").wait_for()
        steer_by_gamepad(page, told, liked)
        page.keyboard.press("1")
        page.get_by_text("kept", exact=True).wait_for()
        for theme in ("light", "dark"):
            root = page.locator("html")
            expect(root).to_have_attribute(
                "data-mantine-color-scheme", theme, timeout=WAIT_MS
            )
            page.wait_for_timeout(400)  # Colours fade.
            keep_picture(page, f"play-page-{theme}.png")
            found[theme] = contrasts(page)
            page.get_by_role("button", name="Light or dark [M]").click()
        nothing_of_viser(page)
        running.close()
        page.get_by_role("heading", name="Connection lost").wait_for()
        nothing_of_viser(page)
        require_readable_cover(page)
        page.close()
    for of_theme in found.values():
        assert len(of_theme) > 20
        assert too_pale(of_theme) == {}


@both_themes
def test_pages_without_a_scene(browser: Browser, tmp_path: Path, theme: Theme) -> None:
    """Login, with a complaint; figures; guidelines."""
    site = Site(tmp_path / "set", pairs=1)
    context = browser.new_context(color_scheme=theme)
    context.set_default_timeout(WAIT_MS)
    page = context.new_page()
    with site.server:
        page.goto(site.server.url)
        page.locator("input[type=password]").fill("wrong")
        page.keyboard.press("Enter")
        page.get_by_text("This token is not known.").wait_for()
        found = contrasts(page)
        context.request.post(
            site.server.url + "/login",
            form={"token": site.tokens["ann"]},
            headers={"Origin": site.server.url},
        )
        for name in ("figures", "guidelines"):
            page.goto(f"{site.server.url}/{name}")
            page.get_by_text("To the pairs").wait_for()
            found += contrasts(page)
    context.close()
    assert len(found) > 40
    assert too_pale(found) == {}
