"""Logging in and out: a form, a signed cookie, and patience with wrong tokens."""

from __future__ import annotations

import logging
from collections.abc import Callable

from aiohttp import web

from .proxy_cfg import ProxyCfg
from .responses import page, redirect
from .tokens import TokenStore
from .visitors import Attempts, Ended
from .web_checks import address_block
from .web_pages import login_page

logger = logging.getLogger(__name__)
_DAY_S = 86_400


class Login:
    """Knows who sent a request."""

    def __init__(
        self,
        cfg: ProxyCfg,
        tokens: TokenStore,
        now_s: Callable[[], float],
        cookie_name: Callable[[], str],
    ) -> None:
        self._cfg = cfg
        self._tokens = tokens
        self._now_s = now_s
        self._cookie_name = cookie_name
        self._attempts = Attempts(per_minute=cfg.login_failures_per_minute)
        self._ended = Ended()

    def rater(self, request: web.Request) -> str | None:
        """Who sent the request; None without a valid cookie."""
        if not self._cfg.auth:
            return self._cfg.local_rater
        parts = request.cookies.get(self._cookie_name(), "").split(".")
        if len(parts) != 3 or not parts[1].isdecimal():
            return None
        rater, expires, signature = parts
        if not self._tokens.is_signed(rater, expires, signature):
            return None
        if f"{rater}.{expires}" in self._ended:
            return None
        return rater if int(expires) > self._now_s() else None

    async def form(self, request: web.Request) -> web.Response:
        """The form; who is logged in goes on to the page."""
        if self.rater(request) is not None:
            return redirect("/")
        return page(login_page())

    async def submit(self, request: web.Request) -> web.Response:
        """Give a cookie for a token."""
        if not self._cfg.auth:
            return redirect("/")
        token = (await request.post()).get("token", "")
        # Nothing is awaited from here on, so that parallel attempts count as well.
        address, now_s = address_block(request.remote), self._now_s()
        if (wait_s := self._attempts.wait_s(address, now_s)) > 0.0:
            response = page(
                login_page("Too many wrong tokens; wait a minute."), status=429
            )
            response.headers["Retry-After"] = str(int(wait_s) + 1)
            return response
        rater = self._tokens.rater_of(token.strip()) if isinstance(token, str) else None
        if rater is None:
            self._attempts.failed(address, now_s)
            logger.warning("a login from %s failed", address)
            return page(login_page("This token is not known."), status=401)
        return self._with_cookie(redirect("/"), rater, now_s)

    def end(self, request: web.Request) -> None:
        """Take no request with this request's cookie any more, were it sent before."""
        rater, _, rest = request.cookies.get(self._cookie_name(), "").partition(".")
        self._ended.add(f"{rater}.{rest.partition('.')[0]}")

    def forget(self, response: web.Response) -> web.Response:
        """The response with the cookie deleted."""
        secure = self._cfg.cert is not None
        response.del_cookie(self._cookie_name(), secure=secure)
        return response

    def _with_cookie(
        self, response: web.Response, rater: str, now_s: float
    ) -> web.Response:
        expires = str(int(now_s) + self._cfg.cookie_days * _DAY_S)
        while f"{rater}.{expires}" in self._ended:
            # Logged out and in again within a second.
            expires = str(int(expires) + 1)
        response.set_cookie(
            self._cookie_name(),
            f"{rater}.{expires}.{self._tokens.signature(rater, expires)}",
            max_age=self._cfg.cookie_days * _DAY_S,
            httponly=True,
            samesite="Strict",
            secure=self._cfg.cert is not None,
        )
        return response
