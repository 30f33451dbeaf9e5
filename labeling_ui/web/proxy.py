"""The authenticating proxy: the only way from the network to the page.

viser has no login, checks no origin and trusts every socket, so it stays on loopback
and this server in the same process decides who comes through.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import defaultdict
from collections.abc import Awaitable, Callable
from functools import partial

from aiohttp import web

from data.errors import GaitprefError
from labeling_ui.limits import page_limits as limits
from labeling_ui.limits.pace import Bucket
from labeling_ui.questions.rater_figures import RaterFigures
from labeling_ui.shell.page_shell import Shell

from .checks import host_name, is_handshake
from .front_door import FrontDoor
from .guidelines import Guidelines
from .http_log import shorten_http_log
from .login import Login
from .pages import figures_page, guidelines_page
from .proxy_cfg import IN_CLEAR, refuse_unsafe, tls_context
from .proxy_cfg import ProxyCfg as ProxyCfg
from .responses import add_security_headers, page, redirect, refused
from .tokens import TokenStore
from .visit import Visit
from .websocket_relay import Relay

logger = logging.getLogger(__name__)
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Proxy:
    """Serves the page of one viser server to raters who logged in."""

    def __init__(
        self,
        cfg: ProxyCfg,
        *,
        upstream_port: int,
        secret: str,
        tokens: TokenStore,
        figures: Callable[[str], RaterFigures],
        shell: Shell,
        now_s: Callable[[], float] = time.time,
    ) -> None:
        """Prepare; `start` opens the port.

        Args:
            upstream_port: Of viser on loopback.
            secret: Tells viser's side that a connection came through here.
            figures: Gives a rater's figures; called in a thread.
            shell: What is put around viser's page.
            now_s: Seconds since 1970.
        """
        self.cfg = cfg
        self._tokens = tokens
        self._figures = figures
        self._told = Guidelines(cfg.guidelines)
        self._port = cfg.port
        self._login = Login(cfg, tokens, now_s, lambda: cfg.cookie_name(self._port))
        self._shell = shell
        self._relay = Relay(
            cfg, upstream_port=upstream_port, secret=secret, around=shell.around
        )
        self._requests: defaultdict[str, Bucket] = defaultdict(
            lambda: Bucket(per_s=limits.REQUESTS_PER_S, at_once=limits.REQUESTS_AT_ONCE)
        )
        self._figures_lock = asyncio.Lock()

    @property
    def url(self) -> str:
        """Where people open the page; the port is known once it was started."""
        public = self.cfg.public_url
        return self.cfg.url(self._port) if public is None else str(public)

    @property
    def notices(self) -> list[str]:
        """What whoever starts the page has to know, line by line."""
        return self.cfg.notices(self._port)

    def visit(self, ticket: str) -> Visit | None:
        """An open page, or one that is being opened; from any thread."""
        return self._relay.visit(ticket)

    async def start(self) -> None:
        """Open the port and serve until `stop`.

        Raises:
            GaitprefError: it would be unsafe, or the port or the certificate cannot be
                used.
        """
        refuse_unsafe(self.cfg, self._tokens)
        context = tls_context(self.cfg)
        shorten_http_log()
        if self.cfg.in_clear:
            logger.warning(IN_CLEAR)
        self._runner = web.AppRunner(
            self._application(),
            access_log=None,
            shutdown_timeout=1.0,
            lingering_time=limits.CLOSE_S,
        )
        await self._runner.setup()
        # Before the port is open: the first visitor may be waiting for it.
        await self._relay.start(self._login.rater)
        host = self.cfg.host.strip("[]")
        assert self._runner.server is not None
        self._door = FrontDoor(self._runner.server)
        try:
            self._port = await self._door.open(host, self.cfg.port, context)
        except OSError as error:
            await self.stop()
            raise GaitprefError(
                f"port {self.cfg.port} on {self.cfg.host} cannot be opened "
                f"({error.strerror or error}); stop what uses it, or choose another "
                "with --port"
            ) from None

    async def stop(self) -> None:
        """Close all pages and the port."""
        await self._door.close()
        await self._relay.stop()
        await self._runner.cleanup()

    def _application(self) -> web.Application:
        app = web.Application(
            middlewares=[self._limit, self._guard, self._pace],
            client_max_size=limits.FORM_BYTES,
        )
        pages = [
            ("GET", "/", self._page),
            ("GET", "/login", self._login.form),
            ("POST", "/login", self._login.submit),
            ("POST", "/logout", self._log_out),
            ("GET", "/healthz", self._health),
            ("GET", "/guidelines", self._guidelines),
            ("GET", "/figures", self._my_figures),
        ]
        add = partial(app.router.add_route, expect_handler=_expected)
        if self.cfg.path:
            add("GET", self.cfg.path, self._front)
        # Also without the path: some proxies take it away.
        for path in dict.fromkeys((self.cfg.path, "")):
            for method, name, handler in pages:
                add(method, path + name, handler)
        add("*", "/{anything:.*}", self._nowhere)
        app.on_response_prepare.append(add_security_headers)
        return app

    @web.middleware
    async def _limit(
        self, request: web.Request, handler: Handler
    ) -> web.StreamResponse:
        """Wait for no request for ever, and for a page as long as it is open."""
        # Who only asks has nothing more to send.
        asks = request.method == "GET"
        on_page = asks and _is_websocket(request)
        with self._door.answering(request, on_page=on_page):
            if asks:
                return await handler(request)
            try:
                async with asyncio.timeout(limits.REQUEST_S):
                    return await handler(request)
            except TimeoutError:
                return refused(408, "The request took too long.")
            except (ConnectionError, RuntimeError, web.RequestPayloadError) as error:
                # aiohttp says in three ways that the sender has left.
                if isinstance(error, RuntimeError) and request.transport is not None:
                    raise
                return refused(400, "The request was not sent to its end.")

    @web.middleware
    async def _guard(
        self, request: web.Request, handler: Handler
    ) -> web.StreamResponse:
        """Turn away what no page of this server sent."""
        host = request.headers.get("Host", "")
        name = host_name(host)
        if name is None:
            return self._turned_away(request, 400, "This is no host name.")
        if not self.cfg.knows(name):
            return self._turned_away(request, 403, self._elsewhere(name))
        acts = request.method != "GET" or _is_websocket(request)
        origins = request.headers.getall("Origin", [])
        origin = origins[0] if len(origins) == 1 else None
        if acts and not self.cfg.is_own(origin, host):
            reason = "This request comes from another site."
            return self._turned_away(request, 403, reason)
        try:
            return await handler(request)
        except GaitprefError as error:
            logger.error("%s", error)
            return refused(503, "The page has a fault; tell whoever runs it.")

    def _turned_away(
        self, request: web.Request, status: int, reason: str
    ) -> web.Response:
        logger.warning("a request from %s is refused: %s", request.remote, reason)
        return refused(status, reason)

    def _elsewhere(self, name: str) -> str:
        """Why nothing is served under a foreign host name, and what would help."""
        if self.cfg.public_url is not None:
            return f"This page is {self.url} (--public-url), and not at {name}."
        if not self.cfg.auth:
            return (
                f"This page is {self.url}, without a login and for this machine only, "
                f"and not at {name}. Behind a reverse proxy, `gaitpref label` takes "
                "--public-url, and tokens in place of --no-auth."
            )
        return (
            f"This page is {self.url}, and not at {name}. Behind a reverse proxy, "
            f"start it with --public-url https://{name} (and the path, if it has one)."
        )

    async def _front(self, request: web.Request) -> web.StreamResponse:
        """The page without the slash at the end, from which links would lead astray."""
        if _is_websocket(request):
            return await self._page(request)
        query = f"?{request.query_string}" if request.query_string else ""
        return redirect(f"{self.cfg.path}/{query}")

    async def _nowhere(self, request: web.Request) -> web.StreamResponse:
        return refused(404, "There is no such page.")

    @web.middleware
    async def _pace(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Refuse a rater who asks for more than anybody reads."""
        rater = self._login.rater(request)
        if rater is None or self._requests[rater].taken(time.monotonic()):
            return await handler(request)
        response = refused(429, "Too many requests; wait a moment.")
        response.headers["Retry-After"] = "1"
        return response

    async def _page(self, request: web.Request) -> web.StreamResponse:
        rater = self._login.rater(request)
        if _is_websocket(request):
            if rater is None:
                return refused(401, "Log in first.")
            if not is_handshake(request.headers):
                return self._turned_away(request, 400, "This opens no websocket.")
            return await self._relay.join(request, rater)
        if rater is None:
            return self._to_login()
        return self._relay.full(rater) or await self._relay.page(request)

    def _to_login(self) -> web.Response:
        return redirect(f"{self.cfg.path}/login")

    async def _log_out(self, request: web.Request) -> web.StreamResponse:
        rater = self._login.rater(request)
        if rater is not None and self.cfg.auth:
            self._login.end(request)
            self._relay.log_out(rater)
        return self._login.forget(self._to_login())

    async def _health(self, request: web.Request) -> web.StreamResponse:
        """Who waits for the server asks this, and an open page whether it still is."""
        rater = self._login.rater(request)
        here = rater is not None and self._relay.is_here(rater)
        found = {"status": "ok", "page": self._shell.version, "here": here}
        return web.json_response(found)

    async def _guidelines(self, request: web.Request) -> web.StreamResponse:
        if self._login.rater(request) is None:
            return self._to_login()
        return page(guidelines_page(await asyncio.to_thread(self._told)))

    async def _my_figures(self, request: web.Request) -> web.StreamResponse:
        rater = self._login.rater(request)
        if rater is None:
            return self._to_login()
        # One after the other: they take the processor from the pages.
        async with self._figures_lock:
            figures = await asyncio.to_thread(self._figures, rater)
        return page(figures_page(figures, can_leave=self.cfg.auth))


def _is_websocket(request: web.Request) -> bool:
    return request.headers.get("Upgrade", "").lower() == "websocket"


async def _expected(request: web.Request) -> None:
    """Answer a client that asks before it sends a form."""
    if request.headers.get("Expect", "").lower() != "100-continue":
        raise web.HTTPExpectationFailed
    assert request.transport is not None
    request.transport.write(b"HTTP/1.1 100 Continue\r\n\r\n")
