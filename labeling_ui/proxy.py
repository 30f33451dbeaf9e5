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

from aiohttp import web

from data.errors import GaitprefError

from . import limits
from .figures import RaterFigures
from .front_door import FrontDoor
from .guidelines import load_guidelines
from .login import Login
from .pace import Bucket
from .proxy_cfg import ProxyCfg as ProxyCfg
from .proxy_cfg import refuse_unsafe, tls_context
from .relay import Relay
from .responses import add_security_headers, page, redirect, refused
from .tokens import TokenStore
from .visit import Visit
from .web_checks import host_name, is_loopback, same_origin
from .web_pages import figures_page, guidelines_page

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
        now_s: Callable[[], float] = time.time,
    ) -> None:
        """Prepare; `start` opens the port.

        Args:
            upstream_port: Of viser on loopback.
            secret: Tells viser's side that a connection came through here.
            figures: Gives a rater's figures; called in a thread.
            now_s: Seconds since 1970.
        """
        self.cfg = cfg
        self._tokens = tokens
        self._figures = figures
        self._port = cfg.port
        self._login = Login(cfg, tokens, now_s, lambda: self._cookie_name)
        self._relay = Relay(cfg, upstream_port=upstream_port, secret=secret)
        self._requests: defaultdict[str, Bucket] = defaultdict(
            lambda: Bucket(per_s=limits.REQUESTS_PER_S, at_once=limits.REQUESTS_AT_ONCE)
        )
        self._figures_lock = asyncio.Lock()

    @property
    def url(self) -> str:
        """Address of the page; the port is known once it was started."""
        return self.cfg.url(self._port)

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
        if self.cfg.in_clear:
            logger.warning(
                "without --cert and --key, tokens and answers cross the network "
                "unencrypted"
            )
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
        app.add_routes(
            [
                web.get("/", self._page, allow_head=False),
                web.get("/login", self._login.form),
                web.post("/login", self._login.submit),
                web.post("/logout", self._log_out),
                web.get("/healthz", self._health),
                web.get("/guidelines", self._guidelines),
                web.get("/figures", self._my_figures),
            ]
        )
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
            return refused(400, "This is no host name.")
        # A foreign name that resolves to this machine makes a foreign page "local".
        if is_loopback(self.cfg.host) and not is_loopback(name):
            return refused(403, f"This server is {self.url}.")
        acts = request.method != "GET" or _is_websocket(request)
        if acts and not same_origin(request.headers.get("Origin"), host):
            return refused(403, "This request comes from another site.")
        return await handler(request)

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
            return await self._relay.join(request, rater)
        return redirect("/login") if rater is None else await self._relay.page(request)

    async def _log_out(self, request: web.Request) -> web.StreamResponse:
        rater = self._login.rater(request)
        if rater is not None and self.cfg.auth:
            self._login.end(request)
            self._relay.log_out(rater)
        return self._login.forget(redirect("/login"))

    async def _health(self, request: web.Request) -> web.StreamResponse:
        return web.json_response({"status": "ok"})

    async def _guidelines(self, request: web.Request) -> web.StreamResponse:
        if self._login.rater(request) is None:
            return redirect("/login")
        # Read every time: the owner may go on writing while people answer.
        return page(guidelines_page(load_guidelines(self.cfg.guidelines)))

    async def _my_figures(self, request: web.Request) -> web.StreamResponse:
        rater = self._login.rater(request)
        if rater is None:
            return redirect("/login")
        # One after the other: they take the processor from the pages.
        async with self._figures_lock:
            figures = await asyncio.to_thread(self._figures, rater)
        return page(figures_page(figures, can_leave=self.cfg.auth))

    @property
    def _cookie_name(self) -> str:
        # Ports share cookies: two servers of one machine must not log each other out.
        prefix = "__Host-" if self.cfg.cert is not None else ""
        return f"{prefix}gaitpref-{self._port}"


def _is_websocket(request: web.Request) -> bool:
    return request.headers.get("Upgrade", "").lower() == "websocket"
