"""One page of one rater, from the moment it is asked for until it is closed."""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections.abc import Callable, Coroutine
from typing import Any

import viser
from aiohttp import web

from data.errors import GaitprefError

from .browser_messages import Message, NotOurs
from .elements import fit

logger = logging.getLogger(__name__)

CLOSE_LOGGED_OUT = 4003
_LONGEST_REASON = 100
_HABITS_COOKIE, _MARKS_COOKIE = "gp-habits", "gp-here"
_LONGEST_KEPT = 100


class Visit:
    """Ends at any moment, also before viser was reached or the browser answered."""

    def __init__(
        self,
        request: web.Request,
        rater: str,
        browser: web.WebSocketResponse,
        rater_of: Callable[[web.Request], str | None],
    ) -> None:
        self.rater, self.browser = rater, browser
        self.ticket = secrets.token_urlsafe(16)
        """Tells viser's side which visit a connection belongs to."""
        self.over: tuple[int, str] | None = None
        """Code and reason, once somebody ended it."""
        self._request, self._rater_of = request, rater_of
        self._ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._gui: viser.GuiApi | None = None

    @property
    def habits(self) -> str:
        """How the rater likes to look, as the browser kept it; anybody may write it."""
        return self._kept(_HABITS_COOKIE)

    @property
    def marks(self) -> str:
        """Moments that the rater marked of an open question, as the browser kept them;
        anybody may write them."""
        return self._kept(_MARKS_COOKIE)

    def _kept(self, name: str) -> str:
        return self._request.cookies.get(name, "")[:_LONGEST_KEPT]

    def seat(self, gui: viser.GuiApi) -> None:
        """From now on, check messages against the elements of this page."""
        self._gui = gui

    def may_stay(self) -> bool:
        """Whether the rater is still logged in.

        Raises:
            GaitprefError: that cannot be known.
        """
        return self._rater_of(self._request) == self.rater

    def may_act(self) -> bool:
        """Whether an answer given here may be stored; from any thread.

        It is asked right before the data base is, so that no answer of a rater follows
        a revocation, however long it has been under way.
        """
        if self.over is not None and self.over[0] == CLOSE_LOGGED_OUT:
            return False
        try:
            return self.may_stay()
        except GaitprefError as error:
            logger.error("nobody can answer: %s", error)
            return False

    def passes(self, message: Message) -> bool:
        """Whether viser is to see this message.

        Raises:
            NotOurs: an honest page would not have sent it.
        """
        if self._gui is None:
            return True
        found = fit(self._gui, message)
        if found == "wrong":
            raise NotOurs("a value does not fit its element")
        return found == "fits"

    def end(self, code: int, reason: str) -> None:
        """Close it, wherever it is; the first reason counts."""
        if self.over is None:
            self.over = (code, reason)
            self._ended.set_result(None)

    async def run(self, work: Coroutine[Any, Any, None]) -> None:
        """Do `work` until it is done or the visit is ended; then say goodbye.

        Raises:
            Exception: what `work` raised, unless the visit was ended before.
        """
        task = asyncio.create_task(work)
        try:
            await asyncio.wait({task, self._ended}, return_when=asyncio.FIRST_COMPLETED)
            if self.over is None:
                task.result()
                return
            # Not waited for yet: viser may take its time.
            task.cancel()
            await self._say_goodbye(*self.over)
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    async def _say_goodbye(self, code: int, reason: str) -> None:
        if not self.browser.prepared:
            # A handshake that is refused tells a browser no reason.
            await self.browser.prepare(self._request)
        message = reason[:_LONGEST_REASON].encode()
        await self.browser.close(code=code, message=message)
