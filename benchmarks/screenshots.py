"""Pictures of every page: `python -m benchmarks.screenshots --run runs/demo`.

They show the pages as people see them, in a real Chromium, at three sizes and in both
themes, and at one size what people meet besides; `labeling.png` and `play.png`, which
the pages show, are two of them.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from data.answers.answer_records import Answer
from data.datasets.dataset import Dataset
from labeling_ui.label_server import LabelCfg, LabelServer
from labeling_ui.web.tokens import TokenStore
from tests.helpers.waiting import wait_for

from .camera import (
    SETTLE_MS,
    SIZE,
    THEMES,
    Camera,
    Size,
    log_in,
    opened,
    page_of,
)
from .screenshot_states import take_states

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

DESKTOP: tuple[Size, ...] = (SIZE, (1440, 900), (1024, 768))
PHONE: tuple[Size, ...] = ((390, 844), (844, 390), (768, 1024))
FLAGS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
_LAID_OUT = """() => [...document.querySelectorAll("[data-dock-region=right]")]
  .every((panel) => panel.getBoundingClientRect().right <= innerWidth + 1
    && panel.getBoundingClientRect().right >= innerWidth - 1)"""
"""Whether the page has followed a new size of its window."""
_PLAN = """
criterion: [high_step, crouch]
seed: [0, 1]
loop:
  rounds: 1
  labels: 12
  steps: {round: 3072, last: 3072}
  evaluation_episodes: 8
  ppo: {num_envs: 32}
  record: {episodes: 40, episode_s: 2.0}
"""
"""Loops of a few seconds."""
ANSWERED = 24
RATER = "ann"


@dataclass(frozen=True, kw_only=True)
class Options:
    """Take pictures of every page."""

    run: Path
    """A finished run of the loop, such as `make demo` makes."""
    out: Path = Path("docs/images")
    """Where a folder for each page is made."""
    pages: tuple[str, ...] = ()
    """Those alone; all by default."""


def main(options: Options) -> None:
    """Take the pictures and say how large they are."""
    from playwright.sync_api import sync_playwright

    chosen = {name: _PAGES[name] for name in options.pages or _PAGES}
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        found = shutil.which("chromium") or shutil.which("google-chrome")
        browser = driver.chromium.launch(executable_path=found, args=FLAGS)
        for name, take in chosen.items():
            camera = Camera(options.out / name)
            take(browser, camera, options.run.resolve(), Path(folder))
            print(f"{name}: {camera.count} pictures, {camera.bytes / 1000:.0f} kB")
        browser.close()
    first = f"{DESKTOP[0][0]}x{DESKTOP[0][1]}-light.png"
    for name, shown in (("label", "labeling.png"), ("play", "play.png")):
        if name in chosen:
            shutil.copy(options.out / name / first, options.out / shown)


def _plain(
    page: Page, camera: Camera, url: str, *, whole: bool = False, drawn: str = "body"
) -> None:
    """A page of text, at every size and in both themes, once `drawn` is there."""
    for theme in THEMES:
        page.emulate_media(color_scheme=theme)
        page.goto(url)
        page.locator(drawn).first.wait_for()
        for width, height in DESKTOP:
            page.set_viewport_size({"width": width, "height": height})
            camera.take(page, (width, height), theme, whole=whole)


def _scene(page: Page, camera: Camera, sizes: tuple[Size, ...]) -> None:
    """A page with robots, at each of `sizes` and in both themes."""
    for theme in THEMES:
        if theme == "dark":
            page.keyboard.press("m")
        for width, height in sizes:
            page.set_viewport_size({"width": width, "height": height})
            wait_for(lambda: page.evaluate(_LAID_OUT))
            page.wait_for_timeout(SETTLE_MS)
            camera.take(page, (width, height), theme)


@contextmanager
def _label_server(
    folder: Path, *, places: int = LabelCfg.most_raters
) -> Iterator[tuple[LabelServer, str]]:
    """The labeling page of walks of the policy that ships, and a token for it."""
    root = folder / "clips"
    if not root.exists():
        _gaitpref("record", "--dataset", root, "--method", "style")
        _gaitpref("pairs", "--dataset", root, "--count", 60)
        _answer(Dataset.open(root))
    tokens = TokenStore(root)
    if RATER in tokens.names():
        tokens.revoke(RATER)
    token = tokens.add(RATER)
    cfg = LabelCfg(port=0, shadows=True, most_raters=places)
    with LabelServer(Dataset.open(root), cfg) as server:
        yield server, token


def _answer(dataset: Dataset) -> None:
    """Answers of half an hour, for the page of figures."""
    at = datetime.now(UTC) - timedelta(minutes=30)
    with dataset.answers() as store:
        store.add_rater(RATER, "human")
        for number, pair in enumerate(store.pairs()[:ANSWERED]):
            took_s = 12.0 - 0.3 * number
            at += timedelta(seconds=took_s + 20)
            answer = Answer(
                answer_id=f"{RATER}-{number}",
                pair_id=pair.pair_id,
                rater_id=RATER,
                choice="ab"[number % 2],  # type: ignore[arg-type]
                p_a=1.0 - number % 2,
                shown_left="a" if number % 3 else "b",
                created_utc=at.isoformat(),
                response_ms=round(1000 * took_s),
            )
            store.add_answer(answer)


def _label(browser: Browser, camera: Camera, run: Path, folder: Path) -> None:
    del run
    with _label_server(folder) as (server, token), page_of(browser) as page:
        log_in(page, server.url, token)
        opened(page, server.url)
        _scene(page, camera, DESKTOP)


def _phone(browser: Browser, camera: Camera, run: Path, folder: Path) -> None:
    del run
    with (
        _label_server(folder) as (server, token),
        page_of(browser, size=PHONE[0], touch=True) as page,
    ):
        log_in(page, server.url, token)
        opened(page, server.url)
        _scene(page, camera, PHONE)


def _login(browser: Browser, camera: Camera, run: Path, folder: Path) -> None:
    del run
    with _label_server(folder) as (server, _), page_of(browser) as page:
        _plain(page, camera, f"{server.url}/login")


def _full(browser: Browser, camera: Camera, run: Path, folder: Path) -> None:
    """What a rater reads while another one has the only place."""
    del run
    with (
        _label_server(folder, places=1) as (server, token),
        page_of(browser) as inside,
        page_of(browser) as page,
    ):
        log_in(inside, server.url, token)
        opened(inside, server.url)
        other = TokenStore(folder / "clips").add("bob")
        log_in(page, server.url, other)
        _plain(page, camera, server.url)


def _text_page(name: str) -> Callable[[Browser, Camera, Path, Path], None]:
    def take(browser: Browser, camera: Camera, run: Path, folder: Path) -> None:
        del run
        with _label_server(folder) as (server, token), page_of(browser) as page:
            log_in(page, server.url, token)
            _plain(page, camera, f"{server.url}/{name}", whole=True)

    return take


def _play(browser: Browser, camera: Camera, run: Path, folder: Path) -> None:
    del folder
    last, first = _policies(run)
    command = ("play", "--port", 0, "--policy", last, "--against", first)
    with _served(*command) as url, page_of(browser) as page:
        page.goto(f"{url}/?fixedDpr=1")
        page.locator("#root canvas[data-engine]").wait_for(state="attached")
        page.wait_for_timeout(3 * SETTLE_MS)
        _scene(page, camera, DESKTOP)


def _watch(browser: Browser, camera: Camera, run: Path, folder: Path) -> None:
    del folder
    # The page names the directory as it was given.
    with (
        _served("watch", os.path.relpath(run), "--port", 0) as url,
        page_of(browser) as page,
    ):
        _plain(page, camera, url, drawn="svg path, svg polyline")


@contextmanager
def _served(*words: object) -> Iterator[str]:
    """Where a command that serves a page says that it is."""
    with subprocess.Popen(
        [sys.executable, "-m", "gaitpref", *map(str, words)],
        stdout=subprocess.PIPE,
        text=True,
    ) as server:
        try:
            assert server.stdout is not None
            yield server.stdout.readline().split()[-1]
        finally:
            server.terminate()


def _report(browser: Browser, camera: Camera, run: Path, folder: Path) -> None:
    del folder
    with page_of(browser) as page:
        _plain(page, camera, (run / "report" / "index.html").as_uri(), whole=True)


def _arena(browser: Browser, camera: Camera, run: Path, folder: Path) -> None:
    last, first = _policies(run)
    out, players = folder / "arena", (f"before={first}", f"after={last}")
    named = [word for player in players for word in ("--policy", player)]
    small = ("--criterion", "high_step", "--most", 12, "--episodes", 5)
    _gaitpref("arena", "--out", out, *named, *small)
    with page_of(browser) as page:
        _plain(page, camera, (out / "index.html").as_uri(), whole=True)


def _explain(browser: Browser, camera: Camera, run: Path, folder: Path) -> None:
    out, rewards = folder / "explained", sorted(run.glob("rounds/*/reward"))
    # The page names the directory as it was given.
    reward = os.path.relpath(rewards[-1])
    on = ("--reward", reward, "--dataset", run / "dataset")
    _gaitpref("explain", *on, "--out", out, "--count", 1)
    with page_of(browser) as page:
        _plain(page, camera, (out / "index.html").as_uri(), whole=True)


def _sweep(browser: Browser, camera: Camera, run: Path, folder: Path) -> None:
    del run
    out, plan = folder / "sweep", folder / "plan.yaml"
    plan.write_text(_PLAN)
    _gaitpref("sweep", "--out", out, "--plan", plan, "--jobs", 2)
    with page_of(browser) as page:
        _plain(page, camera, (out / "index.html").as_uri(), whole=True)


def _states(browser: Browser, camera: Camera, run: Path, folder: Path) -> None:
    del run
    take_states(browser, camera, partial(_label_server, folder), folder)


def _policies(run: Path) -> tuple[Path, Path]:
    """The last policy of a run and its first."""
    found = sorted(run.glob("rounds/*/policy/policy.pt"))
    return found[-1], found[0]


def _gaitpref(*words: object) -> None:
    command = [sys.executable, "-m", "gaitpref", *map(str, words)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


_PAGES: dict[str, Callable[[Browser, Camera, Path, Path], None]] = {
    "login": _login,
    "guidelines": _text_page("guidelines"),
    "figures": _text_page("figures"),
    "report": _report,
    "arena": _arena,
    "label": _label,
    "full": _full,
    "watch": _watch,
    "phone": _phone,
    "play": _play,
    "explain": _explain,
    "sweep": _sweep,
    "states": _states,
}


if __name__ == "__main__":
    main(tyro.cli(Options))
