"""The page behind a reverse proxy, at a path of its own and at the root."""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from benchmarks.visitor import Visitor
from benchmarks.walks import walking_dataset
from data.dataset import Dataset
from data.errors import GaitprefError
from gaitpref.cli import main
from labeling_ui.public_url import parse_public_url
from labeling_ui.tokens import TokenStore
from labeling_ui.web_checks import visitor_address

from .labeling_visitor import PROTOCOL, House, house
from .reverse_proxy import NAME, ReverseProxy, free_port, reverse_proxy

PUBLIC = "https://label.example.org/gait"


@contextmanager
def labeling(root: Path, *options: str) -> Iterator[list[str]]:
    """`gaitpref label` as a process; gives what it says, ends it by SIGTERM."""
    log = root.with_suffix(".log")
    with log.open("wb") as errors:
        process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "gaitpref.cli",
                "label",
                "--dataset",
                root,
                *options,
            ],
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
        )
    assert process.stdout is not None
    said: list[str] = []
    try:
        for line in process.stdout:
            said.append(line.strip())
            if line.startswith("make a token"):
                break
        assert said, log.read_text()
        yield said
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=60) == 0
        assert "Traceback" not in log.read_text()
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


async def stores_an_answer(url: str, token: str, proxy: ReverseProxy) -> None:
    """Log in, open the socket where the page's own client opens it, and answer."""
    visitor = Visitor(url, token, proxy.connector)
    page = asyncio.create_task(visitor.run())
    async with asyncio.timeout(60):
        work = asyncio.create_task(visitor.until_moving())
        await asyncio.wait({page, work}, return_when=asyncio.FIRST_COMPLETED)
        if page.done():
            page.result()
        await visitor.press("Close the dialog")
        await asyncio.sleep(0.7)
        await visitor.press("A better")
        await visitor.until_answered(1)
    page.cancel()
    await asyncio.gather(page, return_exceptions=True)


async def looks_around(origin: str, path: str, proxy: ReverseProxy) -> None:
    """Every address a browser is sent to lies under the path."""
    async with aiohttp.ClientSession(connector=proxy.connector()) as browser:

        async def get(address: str) -> tuple[int, str, str]:
            async with browser.get(origin + address, allow_redirects=False) as answer:
                location = answer.headers.get("Location", "")
                return answer.status, location, await answer.text()

        assert (await get(f"{path}/"))[:2] == (303, f"{path}/login")
        if path:
            assert (await get(f"{path}?darkMode=1"))[:2] == (303, f"{path}/?darkMode=1")
        status, _, text = await get(f"{path}/login")
        assert (status, 'action="login"' in text, 'href="/' in text) == (
            200,
            True,
            False,
        )


async def is_patient_with_everybody_alone(
    origin: str, path: str, token: str, proxy: ReverseProxy
) -> None:
    """Wrong tokens of one address keep no other out, and nobody can lend another one."""

    async def login(browser: aiohttp.ClientSession, given: str) -> int:
        async with browser.post(
            f"{origin}{path}/login",
            data={"token": given},
            headers={"Origin": origin, "X-Forwarded-For": "127.0.0.1"},
            allow_redirects=False,
        ) as answer:
            return answer.status

    async with (
        aiohttp.ClientSession(connector=proxy.connector("127.0.0.2")) as guessing,
        aiohttp.ClientSession(connector=proxy.connector()) as honest,
    ):
        tries = [await login(guessing, f"wrong{number}") for number in range(11)]
        assert tries == [401] * 10 + [429]
        assert await login(honest, token) == 303


async def visits(origin: str, path: str, token: str, proxy: ReverseProxy) -> None:
    """Everything a proxy has to be good for."""
    await looks_around(origin, path, proxy)
    await stores_an_answer(f"{origin}{path}", token, proxy)
    await is_patient_with_everybody_alone(origin, path, token, proxy)
    # TLS takes its leave after a session is closed.
    await asyncio.sleep(0.3)


@pytest.mark.parametrize("path", ["/gait", ""])
@pytest.mark.parametrize("kind", ["nginx", "caddy"])
def test_the_documented_block_works(tmp_path: Path, kind: str, path: str) -> None:
    """Login, socket and answer through a real proxy, by the real command."""
    port, page_port = free_port(), free_port()
    root = tmp_path / "set"
    dataset = walking_dataset(root, pairs=3)
    token = TokenStore(root).add("ann")
    origin = f"https://{NAME}:{port}"
    with (
        reverse_proxy(
            kind, tmp_path, port=port, page_port=page_port, path=path
        ) as proxy,
        labeling(
            root, "--port", str(page_port), "--public-url", f"{origin}{path}"
        ) as said,
    ):
        assert said[0] == f"the labeling page is at {origin}{path}/"
        assert said[1].endswith(f"pass it on to http://127.0.0.1:{page_port}")
        asyncio.run(visits(origin, path, token, proxy))
    with Dataset.open(dataset.root).answers() as store:
        assert store.count(rater_id="ann") == 1
