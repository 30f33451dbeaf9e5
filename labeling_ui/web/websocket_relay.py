"""Carries pages and messages between browsers and viser on loopback."""

from __future__ import annotations

import asyncio
import gzip
import logging
import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import suppress
from functools import partial

import aiohttp
from aiohttp import ClientWebSocketResponse, WSMsgType, web
from yarl import URL

from data.errors import GaitprefError
from labeling_ui.limits import page_limits as limits
from labeling_ui.limits.pace import Bucket

from .browser_messages import NotOurs, read, spelled
from .checks import is_page_parameter, page_policy, viser_protocol
from .pages import full_page
from .proxied import RATER_HEADER, SECRET_HEADER, VISIT_HEADER
from .proxy_cfg import ProxyCfg
from .pump import pump
from .responses import page, redirect, refused
from .visit import CLOSE_LOGGED_OUT as CLOSE_LOGGED_OUT
from .visit import Visit
from .visitors import Departures, Visitors

logger = logging.getLogger(__name__)

CLOSE_GOING_AWAY = 1001
CLOSE_NOT_OURS = 1003
CLOSE_REPLACED = 4001
CLOSE_FLOOD = 4008
_REACH_S = 20.0
"""How long viser is tried: while it builds the pages of many raters who come at once,
it lets a handshake wait, and may drop it."""
_REACH_AGAIN_S = 0.2
_CLOSE = aiohttp.ClientWSTimeout(ws_close=limits.CLOSE_S)  # type: ignore[call-arg]
_NOT_UP = "The page is not up; try again."
_PACKED = {"Content-Encoding": "gzip"}


class Relay:
    """The open pages of all raters."""

    def __init__(
        self,
        cfg: ProxyCfg,
        *,
        upstream_port: int,
        secret: str,
        around: Callable[[bytes], bytes],
    ) -> None:
        """Nobody is there.

        Args:
            around: Gives viser's page as browsers get it.
        """
        self._cfg, self._around = cfg, around
        self._upstream = f"127.0.0.1:{upstream_port}"
        self._secret = secret
        self._visitors: Visitors[Visit] = Visitors(
            per_rater=cfg.max_clients_per_rater, in_all=cfg.max_clients
        )
        self._departures = Departures(time.monotonic())
        self._visits: dict[str, Visit] = {}
        self._openings: defaultdict[str, Bucket] = defaultdict(
            partial(
                Bucket, per_s=limits.OPENINGS_PER_S, at_once=limits.OPENINGS_AT_ONCE
            )
        )
        # Of the rater, so that a page opened anew goes on where the last was closed.
        self._messages: defaultdict[str, Bucket] = defaultdict(
            partial(
                Bucket, per_s=limits.MESSAGES_PER_S, at_once=limits.MESSAGES_AT_ONCE
            )
        )
        self._pages: dict[bool, tuple[bytes, dict[str, str]]] = {}

    async def start(self, rater_of: Callable[[web.Request], str | None]) -> None:
        """Start to throw out whom `rater_of` does not know any more."""
        self._rater_of = rater_of
        self._client = aiohttp.ClientSession(
            auto_decompress=False,
            # viser ends a connection after every page without saying so beforehand.
            connector=aiohttp.TCPConnector(limit=0, force_close=True),
            cookie_jar=aiohttp.DummyCookieJar(),
        )
        self._watch = asyncio.create_task(self._watched())

    async def stop(self) -> None:
        """Close all pages."""
        self._watch.cancel()
        for visit in self._visits.values():
            visit.end(CLOSE_GOING_AWAY, "the server stops")
        with suppress(TimeoutError):
            async with asyncio.timeout(2 * limits.CLOSE_S):
                while self._visits:
                    await asyncio.sleep(0.01)
        await asyncio.gather(self._watch, return_exceptions=True)
        await self._client.close()

    def visit(self, ticket: str) -> Visit | None:
        """The visit with this ticket, while it lasts; from any thread."""
        return self._visits.get(ticket)

    def is_here(self, rater: str) -> bool:
        """Whether a rater has a page open."""
        return bool(self._visitors.of(rater))

    def log_out(self, rater: str) -> None:
        """Close a rater's pages."""
        for visit in self._visitors.of(rater):
            visit.end(CLOSE_LOGGED_OUT, "logged out")

    def full(self, rater: str) -> web.Response | None:
        """What a rater is told for whom there is no place; None where there is one."""
        if self._visitors.has_room(rater):
            return None
        wait_s = self._departures.wait_s(time.monotonic())
        response = page(full_page(self._cfg.max_clients, wait_s), status=503)
        response.headers["Retry-After"] = str(round(wait_s or limits.FULL_WAIT_S))
        # Whoever leaves it open comes in by and by.
        response.headers["Refresh"] = str(round(limits.FULL_S))
        return response

    async def page(self, request: web.Request) -> web.StreamResponse:
        """viser's page; parameters that could turn it against the rater are dropped."""
        allowed = [(k, v) for k, v in request.query.items() if is_page_parameter(k)]
        if len(allowed) < len(request.query):
            here = URL(f"{self._cfg.path}/")
            return redirect(str(here.with_query(allowed)))
        if self._client.closed:
            return _again(refused(502, _NOT_UP))
        try:
            packed = "gzip" in request.headers.get("Accept-Encoding", "")
            body, headers = await self._page(packed)
        except aiohttp.ClientError as error:
            logger.warning("no page: %r", error)
            return _again(refused(502, _NOT_UP))
        public = self._cfg.public_url
        host = request.headers["Host"] if public is None else public.netloc
        policy = {"Content-Security-Policy": page_policy(host)}
        return web.Response(body=body, headers=headers | policy)

    async def _page(self, packed: bool) -> tuple[bytes, dict[str, str]]:
        """The page and its headers; viser is asked once, for it never changes.

        Raises:
            aiohttp.ClientError: viser does not give it.
        """
        if packed not in self._pages:
            asked = {SECRET_HEADER: self._secret, "Accept-Encoding": "identity"}
            url = f"http://{self._upstream}/"
            async with self._client.get(
                url, headers=asked, raise_for_status=True
            ) as answer:
                body = self._around(await answer.read())
            headers = {"Content-Type": "text/html; charset=utf-8"}
            self._pages[False] = (body, headers)
            self._pages[True] = (gzip.compress(body), headers | _PACKED)
        return self._pages[packed]

    async def join(self, request: web.Request, rater: str) -> web.StreamResponse:
        """Join a browser's socket to one of viser's, until either ends."""
        protocol = viser_protocol(request.headers.get("Sec-WebSocket-Protocol", ""))
        if protocol is None:
            return refused(400, "This is not the page's client.")
        browser = web.WebSocketResponse(
            protocols=[protocol],
            max_msg_size=limits.MESSAGE_BYTES,
            compress=False,
            heartbeat=30.0,
            timeout=limits.CLOSE_S,
        )
        visit = Visit(request, rater, browser, self._rater_of)
        leaving = self._visitors.enter(visit, rater)
        if leaving is None:
            return refused(503, "Too many pages are open; try again later.")
        for old in leaving:
            old.end(CLOSE_REPLACED, "opened in another window")
        self._visits[visit.ticket] = visit
        came_s = time.monotonic()
        try:
            await visit.run(self._carry(request, visit, protocol))
        except ConnectionResetError:
            # It left while viser was being reached; its next try is a visit of its own.
            return browser
        except (aiohttp.ClientError, TimeoutError) as error:
            if not browser.prepared:
                logger.warning("no page for %s: %s", rater, str(error) or repr(error))
                return refused(502, _NOT_UP)
        finally:
            self._visitors.leave(visit)
            self._departures.left(came_s, time.monotonic())
            del self._visits[visit.ticket]
        return browser

    async def _carry(self, request: web.Request, visit: Visit, protocol: str) -> None:
        openings = self._openings[visit.rater]
        while not openings.taken(time.monotonic()):
            await asyncio.sleep(openings.wait_s(time.monotonic()))
        async with await self._reach(protocol, visit) as viser:
            await visit.browser.prepare(request)
            await pump(self._from_browser(visit, viser), visit.browser, viser)

    async def _reach(self, protocol: str, visit: Visit) -> ClientWebSocketResponse:
        """A socket to viser for a visit.

        Raises:
            aiohttp.ClientError, TimeoutError: viser did not answer in time.
        """
        shown = {
            SECRET_HEADER: self._secret,
            RATER_HEADER: visit.rater,
            VISIT_HEADER: visit.ticket,
        }
        async with asyncio.timeout(_REACH_S):
            while True:
                if self._client.closed:
                    raise aiohttp.ClientConnectionError("the server stops")
                try:
                    return await self._client.ws_connect(
                        f"ws://{self._upstream}/",
                        protocols=[protocol],
                        headers=shown,
                        max_msg_size=0,
                        timeout=_CLOSE,
                    )
                except aiohttp.ClientError as error:
                    logger.info("viser is tried again for %s: %s", visit.rater, error)
                    await asyncio.sleep(_REACH_AGAIN_S)

    async def _from_browser(self, visit: Visit, viser: ClientWebSocketResponse) -> None:
        """Carry what the page may say, as fast as a hand can make it."""
        bucket = self._messages[visit.rater]
        async for message in visit.browser:
            if message.type is not WSMsgType.BINARY:
                reason = message.data if message.type is WSMsgType.ERROR else "text"
                self._refuse(visit, CLOSE_NOT_OURS, f"no message of the page: {reason}")
                return
            while (wait_s := bucket.wait_s(now_s := time.monotonic())) > 0.0:
                if bucket.pressed_s(now_s) > limits.FLOOD_S:
                    self._refuse(visit, CLOSE_FLOOD, "too many messages")
                    return
                # Nothing more is read meanwhile: what is sent waits at the sender.
                await asyncio.sleep(wait_s)
            bucket.take(now_s, 1 + len(message.data) // limits.MESSAGE_UNIT_BYTES)
            try:
                said = read(message.data)
                if visit.passes(said) and visit.over is None:
                    await viser.send_bytes(spelled(said))
            except NotOurs as error:
                reason = f"no message of the page: {error}"
                self._refuse(visit, CLOSE_NOT_OURS, reason)
                return

    def _refuse(self, visit: Visit, code: int, reason: str) -> None:
        logger.warning("the page of %s is closed: %s", visit.rater, ascii(reason))
        visit.end(code, ascii(reason)[1:-1])

    async def _watched(self) -> None:
        while True:
            await asyncio.sleep(limits.WATCH_S)
            for visit in self._visitors.everybody():
                try:
                    if not visit.may_stay():
                        visit.end(CLOSE_LOGGED_OUT, "logged out")
                except GaitprefError as error:
                    logger.error("nobody can be logged out: %s", error)


def _again(response: web.Response) -> web.Response:
    """Have the browser ask again soon; nothing else would."""
    response.headers["Refresh"] = "2"
    return response
