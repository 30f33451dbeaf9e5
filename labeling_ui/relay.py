"""Carries pages and messages between browsers and viser on loopback."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from typing import Any

import aiohttp
from aiohttp import ClientWebSocketResponse, WSMsgType, web
from yarl import URL

from data.errors import GaitprefError

from .proxied import RATER_HEADER, SECRET_HEADER
from .proxy_cfg import ProxyCfg
from .responses import redirect, refused
from .visitors import Visitors
from .web_checks import is_page_parameter, page_policy, viser_protocol

logger = logging.getLogger(__name__)

CLOSE_GOING_AWAY = 1001
CLOSE_NOT_BINARY = 1003
CLOSE_BROKEN = 1011
CLOSE_REPLACED = 4001
CLOSE_LOGGED_OUT = 4003
_WATCH_S = 1.0
_REACH_S = 20.0
"""How long viser is tried: while it builds the pages of many raters who come at once,
it lets a handshake wait, and may drop it."""
_REACH_AGAIN_S = 0.2
_NOT_UP = "The page is not up; try again."


@dataclass(frozen=True, eq=False)
class _Visit:
    """An open page."""

    request: web.Request
    browser: web.WebSocketResponse

    async def close(self, code: int, reason: str) -> None:
        if self.browser.prepared:
            await self.browser.close(code=code, message=reason.encode())


class Relay:
    """The open pages of all raters."""

    def __init__(self, cfg: ProxyCfg, *, upstream_port: int, secret: str) -> None:
        self._cfg = cfg
        self._upstream = f"127.0.0.1:{upstream_port}"
        self._secret = secret
        self._visitors: Visitors[_Visit] = Visitors(
            per_rater=cfg.max_clients_per_rater, in_all=cfg.max_clients
        )
        self._closing: set[asyncio.Task[None]] = set()

    async def start(self, rater_of: Callable[[web.Request], str | None]) -> None:
        """Start to throw out whom `rater_of` does not know any more."""
        self._client = aiohttp.ClientSession(
            auto_decompress=False,
            # viser ends a connection after every page without saying so beforehand.
            connector=aiohttp.TCPConnector(limit=0, force_close=True),
            cookie_jar=aiohttp.DummyCookieJar(),
        )
        self._watch = asyncio.create_task(self._watched(rater_of))

    async def stop(self) -> None:
        """Close all pages."""
        self._watch.cancel()
        for visit in self._visitors.everybody():
            self._spawn(visit.close(CLOSE_GOING_AWAY, "the server stops"))
        await asyncio.gather(self._watch, *self._closing, return_exceptions=True)
        await self._client.close()

    def log_out(self, rater: str) -> None:
        """Close a rater's pages."""
        for visit in self._visitors.of(rater):
            self._spawn(visit.close(CLOSE_LOGGED_OUT, "logged out"))

    async def page(self, request: web.Request) -> web.StreamResponse:
        """viser's page; parameters that could turn it against the rater are dropped."""
        allowed = [(k, v) for k, v in request.query.items() if is_page_parameter(k)]
        if len(allowed) < len(request.query):
            here = URL(f"{self._cfg.path}/")
            return redirect(str(here.with_query(allowed)))
        if self._client.closed:
            return refused(502, _NOT_UP)
        zipped = "gzip" in request.headers.get("Accept-Encoding", "")
        accepted = {"Accept-Encoding": "gzip" if zipped else "identity"}
        url = f"http://{self._upstream}/"
        try:
            async with self._client.get(url, headers=accepted) as answer:
                body = await answer.read()
        except aiohttp.ClientError as error:
            logger.warning("no page: %r", error)
            return refused(502, _NOT_UP)
        kept = ("Content-Type", "Content-Encoding")
        headers = {
            name: answer.headers[name] for name in kept if name in answer.headers
        }
        headers["Content-Security-Policy"] = page_policy(
            request.headers["Host"]
            if self._cfg.public_url is None
            else self._cfg.public_url.netloc
        )
        return web.Response(status=answer.status, body=body, headers=headers)

    async def join(self, request: web.Request, rater: str) -> web.StreamResponse:
        """Join a browser's socket to one of viser's, until either ends."""
        protocol = viser_protocol(request.headers.get("Sec-WebSocket-Protocol", ""))
        if protocol is None:
            return refused(400, "This is not the page's client.")
        browser = web.WebSocketResponse(
            protocols=[protocol],
            max_msg_size=self._cfg.max_message_bytes,
            compress=False,
            heartbeat=30.0,
        )
        visit = _Visit(request, browser)
        leaving = self._visitors.enter(visit, rater)
        if leaving is None:
            return refused(503, "Too many pages are open; try again later.")
        for old in leaving:
            self._spawn(old.close(CLOSE_REPLACED, "opened in another window"))
        try:
            async with await self._reach(protocol, rater) as viser:
                await browser.prepare(request)
                await _pump(browser, viser)
        except ConnectionResetError:
            # It left while viser was being reached; its next try is a visit of its own.
            return browser
        except (aiohttp.ClientError, TimeoutError) as error:
            if not browser.prepared:
                logger.warning("no page for %s: %s", rater, str(error) or repr(error))
                return refused(502, _NOT_UP)
        finally:
            self._visitors.leave(visit)
        return browser

    async def _reach(self, protocol: str, rater: str) -> ClientWebSocketResponse:
        """A socket to viser for `rater`.

        Raises:
            aiohttp.ClientError, TimeoutError: viser did not answer in time.
        """
        async with asyncio.timeout(_REACH_S):
            while True:
                if self._client.closed:
                    raise aiohttp.ClientConnectionError("the server stops")
                try:
                    return await self._client.ws_connect(
                        f"ws://{self._upstream}/",
                        protocols=[protocol],
                        headers={SECRET_HEADER: self._secret, RATER_HEADER: rater},
                        max_msg_size=0,
                    )
                except aiohttp.ClientError as error:
                    logger.info("viser is tried again for %s: %s", rater, error)
                    await asyncio.sleep(_REACH_AGAIN_S)

    async def _watched(self, rater_of: Callable[[web.Request], str | None]) -> None:
        while True:
            await asyncio.sleep(_WATCH_S)
            try:
                for visit in self._visitors.everybody():
                    if rater_of(visit.request) is None:
                        self._spawn(visit.close(CLOSE_LOGGED_OUT, "logged out"))
            except GaitprefError as error:
                logger.error("nobody can be logged out: %s", error)

    def _spawn(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        # The event loop itself keeps no hold of a task.
        self._closing.add(task)
        task.add_done_callback(self._closing.discard)


async def _pump(browser: web.WebSocketResponse, viser: ClientWebSocketResponse) -> None:
    """Carry messages both ways until one side ends; then end the other."""
    tasks = [
        asyncio.create_task(_from_browser(browser, viser)),
        asyncio.create_task(_from_viser(browser, viser)),
    ]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    if viser.closed and not browser.closed:
        code = viser.close_code or CLOSE_BROKEN
        # 1006 says that nothing was said, and must not itself be said.
        await browser.close(code=CLOSE_BROKEN if code == 1006 else code)


async def _from_browser(
    browser: web.WebSocketResponse, viser: ClientWebSocketResponse
) -> None:
    async for message in browser:
        if message.type is not WSMsgType.BINARY:
            await browser.close(code=CLOSE_NOT_BINARY)
            return
        await viser.send_bytes(message.data)


async def _from_viser(
    browser: web.WebSocketResponse, viser: ClientWebSocketResponse
) -> None:
    async for message in viser:
        if message.type is WSMsgType.BINARY:
            await browser.send_bytes(message.data)
