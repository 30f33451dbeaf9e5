"""What pictures of pages are taken with: `python -m benchmarks.screenshots`."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from PIL import Image

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

Theme = Literal["light", "dark"]
Size = tuple[int, int]
THEMES: tuple[Theme, ...] = ("light", "dark")
SIZE: Size = (1280, 720)
"""Of a window, where one size is enough."""
COLOURS = 200
"""A picture has as many at most: about a third of the bytes."""
WAIT_MS, SETTLE_MS = 180_000, 6_000
"""For a page to come, and for its scene to be drawn without a graphics card."""


class Camera:
    """Keeps pictures of one page."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.count = self.bytes = 0

    def take(
        self, page: Page, name: Size | str, theme: Theme, *, whole: bool = False
    ) -> None:
        """One picture of the window, or of the whole page, as few bytes as it takes.

        Args:
            page: What is shown.
            name: What the picture is called: the window's size, or what it shows.
            theme: Follows the name.
            whole: Of more than the window.
        """
        self._folder.mkdir(parents=True, exist_ok=True)
        picture = Image.open(io.BytesIO(page.screenshot(full_page=whole)))
        few = picture.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
        stem = name if isinstance(name, str) else f"{name[0]}x{name[1]}"
        path = self._folder / f"{stem}-{theme}.png"
        few.save(path, optimize=True)
        self.count += 1
        self.bytes += path.stat().st_size


@contextmanager
def page_of(
    browser: Browser, *, size: Size = SIZE, touch: bool = False
) -> Iterator[Page]:
    """A window of its own, with nobody logged in."""
    context = browser.new_context(
        viewport={"width": size[0], "height": size[1]}, has_touch=touch, is_mobile=touch
    )
    context.set_default_timeout(WAIT_MS)
    yield context.new_page()
    context.close()


def log_in(page: Page, url: str, token: str) -> None:
    """Give the window the cookie of a rater."""
    page.request.post(f"{url}/login", form={"token": token}, headers={"Origin": url})


def opened(page: Page, url: str) -> None:
    """Open the labeling page and close what is in front."""
    page.goto(f"{url}/?fixedDpr=1")
    page.locator("[data-gp-ready]").wait_for(state="attached")
    page.wait_for_timeout(SETTLE_MS)
    page.keyboard.press("Escape")
