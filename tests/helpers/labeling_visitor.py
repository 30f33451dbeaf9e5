"""Stands in for a browser before the labeling page, and for what an attacker sends."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import aiohttp
import msgspec
import viser
import zstandard

from labeling_ui.questions.rater_figures import RaterFigures, figures
from labeling_ui.shell.page_shell import Shell
from labeling_ui.web.proxy import Proxy, ProxyCfg
from labeling_ui.web.tokens import TokenStore

PROTOCOL = f"viser-v{viser.__version__}"
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (1.0, 1.0, 1.0),
    "fov": 1.0,
    "near": 0.1,
    "far": 10.0,
    "image_height": 100,
    "image_width": 100,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}


@dataclass(frozen=True)
class House:
    """A proxy that serves, and somebody with a browser before its door."""

    proxy: Proxy
    tokens: TokenStore
    browser: aiohttp.ClientSession

    @property
    def url(self) -> str:
        return self.proxy.url

    async def login(self, token: str) -> int:
        """Send the form; gives the status."""
        async with self.browser.post(
            f"{self.url}/login",
            data={"token": token},
            headers={"Origin": self.url},
            allow_redirects=False,
        ) as response:
            return response.status

    async def get(self, path: str, **headers: str) -> tuple[int, str, dict[str, str]]:
        """Status, text and headers."""
        async with self.browser.get(
            f"{self.url}{path}", headers=headers, allow_redirects=False
        ) as response:
            return response.status, await response.text(), dict(response.headers)

    async def knock(self, **headers: str) -> int:
        """Try to open a socket; the status it is answered with."""
        try:
            socket = await open_socket(self.browser, self.url, **headers)
        except aiohttp.WSServerHandshakeError as error:
            return error.status
        await socket.close()
        return 101

    async def enter(self, **headers: str) -> aiohttp.ClientWebSocketResponse:
        """Open the page: a socket that has announced its camera."""
        socket = await open_socket(self.browser, self.url, **headers)
        await send(socket, CAMERA)
        return socket


async def open_socket(
    browser: aiohttp.ClientSession, url: str, **headers: str
) -> aiohttp.ClientWebSocketResponse:
    """A socket to the page, as its client opens it."""
    given = {"Origin": url} | headers
    return await browser.ws_connect(
        f"{url}/",
        protocols=[PROTOCOL],
        headers={name.replace("_", "-"): value for name, value in given.items()},
        max_msg_size=0,
    )


async def send(
    socket: aiohttp.ClientWebSocketResponse, message: dict[str, Any]
) -> None:
    """Send one message as viser's client spells it."""
    await socket.send_bytes(msgspec.msgpack.encode(message))


async def messages(
    socket: aiohttp.ClientWebSocketResponse, *, within_s: float = 5.0
) -> AsyncIterator[dict[str, Any]]:
    """What the page is told, until nothing comes for a while."""
    while True:
        try:
            received = await socket.receive(timeout=within_s)
        except TimeoutError:
            return
        if received.type is not aiohttp.WSMsgType.BINARY:
            return
        size = int.from_bytes(received.data[8:16], "little")
        packed = zstandard.ZstdDecompressor().decompress(received.data[16 : 16 + size])
        for message in msgspec.msgpack.decode(packed)["messages"]:
            yield message


async def first(
    socket: aiohttp.ClientWebSocketResponse,
    wanted: Callable[[dict[str, Any]], bool],
    *,
    within_s: float = 5.0,
) -> dict[str, Any] | None:
    """The first message that is wanted; None if it does not come."""
    async for message in messages(socket, within_s=within_s):
        if wanted(message):
            return message
    return None


async def close_code(socket: aiohttp.ClientWebSocketResponse) -> int | None:
    """Wait until the other side ends; its code."""

    while True:
        received = await socket.receive(timeout=10.0)
        if received.type is aiohttp.WSMsgType.CLOSE:
            return received.data
        if received.type is not aiohttp.WSMsgType.BINARY:
            return socket.close_code


@asynccontextmanager
async def house(
    root: Path,
    *,
    upstream_port: int = 9,
    secret: str = "",
    figures_of: Callable[[str], RaterFigures] = lambda name: figures([], name),
    now_s: Callable[[], float] | None = None,
    **cfg: Any,
) -> AsyncIterator[House]:
    """A proxy on a free port, with the tokens in `root`."""
    cfg.setdefault("port", 0)
    tokens = TokenStore(root)
    clock = {} if now_s is None else {"now_s": now_s}
    proxy = Proxy(
        ProxyCfg(**cfg),
        upstream_port=upstream_port,
        secret=secret,
        tokens=tokens,
        figures=figures_of,
        shell=Shell(title="A page", scene="Nothing"),
        **clock,
    )
    jar = aiohttp.CookieJar(unsafe=True)
    async with aiohttp.ClientSession(cookie_jar=jar) as browser:
        await proxy.start()
        try:
            yield House(proxy, tokens, browser)
        finally:
            await proxy.stop()
