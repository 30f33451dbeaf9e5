"""Logging in and out: a form, a signed cookie, and patience with wrong tokens."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable

from aiohttp import web

from .checks import address_block, form_field, visitor_address
from .pages import login_page
from .proxy_cfg import LOCAL_RATER, ProxyCfg
from .responses import page, redirect
from .tokens import TokenStore
from .visitors import Attempts, Ended

logger = logging.getLogger(__name__)
_LASTS_S = 14 * 86_400
"""How long a login does."""
_COOKIE = re.compile(
    r"(?P<rater>[A-Za-z0-9_-]+)\.(?P<expires>[0-9]{1,12})\.(?P<signature>[0-9a-f]{64})"
)


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
            return LOCAL_RATER
        cookie = _COOKIE.fullmatch(request.cookies.get(self._cookie_name(), ""))
        if cookie is None or not self._tokens.is_signed(*cookie.groups()):
            return None
        if f"{cookie['rater']}.{cookie['expires']}" in self._ended:
            return None
        return cookie["rater"] if int(cookie["expires"]) > self._now_s() else None

    async def form(self, request: web.Request) -> web.Response:
        """The form; who is logged in goes on to the page."""
        if self.rater(request) is not None:
            return self._to_the_page()
        return page(login_page())

    async def submit(self, request: web.Request) -> web.Response:
        """Give a cookie for a token."""
        if not self._cfg.auth:
            return self._to_the_page()
        token = await _sent(request)
        # Nothing is awaited from here on, so that parallel attempts count as well.
        address, now_s = self._address(request), self._now_s()
        if (wait_s := self._attempts.wait_s(address, now_s)) > 0.0:
            response = page(
                login_page("Too many wrong tokens; wait a minute."), status=429
            )
            response.headers["Retry-After"] = str(int(wait_s) + 1)
            return response
        rater = None if token is None else self._tokens.rater_of(token.strip())
        if rater is None:
            self._attempts.failed(address, now_s)
            logger.warning("a login from %s failed", address)
            return page(login_page("This token is not known."), status=401)
        return self._with_cookie(self._to_the_page(), rater, now_s)

    def end(self, request: web.Request) -> None:
        """Take no request with this request's cookie any more, were it sent before."""
        rater, _, rest = request.cookies.get(self._cookie_name(), "").partition(".")
        self._ended.add(f"{rater}.{rest.partition('.')[0]}")

    def forget(self, response: web.Response) -> web.Response:
        """The response with the cookie deleted."""
        response.del_cookie(
            self._cookie_name(), path=self._cookie_path, secure=self._cfg.secure
        )
        return response

    def _to_the_page(self) -> web.Response:
        return redirect(f"{self._cfg.path}/")

    def _address(self, request: web.Request) -> str:
        forwarded = request.headers.getall("X-Forwarded-For", [])
        proxied = self._cfg.public_url is not None
        return address_block(
            visitor_address(request.remote, forwarded, proxied=proxied)
        )

    @property
    def _cookie_path(self) -> str:
        # Without a slash at the end: viser's client opens its socket there.
        return self._cfg.path or "/"

    def _with_cookie(
        self, response: web.Response, rater: str, now_s: float
    ) -> web.Response:
        expires = str(int(now_s) + _LASTS_S)
        while f"{rater}.{expires}" in self._ended:
            # Logged out and in again within a second.
            expires = str(int(expires) + 1)
        response.set_cookie(
            self._cookie_name(),
            f"{rater}.{expires}.{self._tokens.signature(rater, expires)}",
            max_age=_LASTS_S,
            path=self._cookie_path,
            httponly=True,
            samesite="Strict",
            secure=self._cfg.secure,
        )
        return response


async def _sent(request: web.Request) -> str | None:
    """The token in a form; None if it is not the form of the login page.

    Raises:
        HTTPRequestEntityTooLarge: the form is larger than any of ours.
    """
    try:
        body = await request.read()
    except web.RequestPayloadError:
        return None
    return form_field(body, "token")
