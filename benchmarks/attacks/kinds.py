"""What is done with the inputs against the page, and what counts as held."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import aiohttp
import msgspec

from .floods import CROWD, Held, crowds, floods, greed
from .ground import Ground, Target
from .inputs import FOREIGN, REQUESTS, UNKNOWN, WRONG


@dataclass(frozen=True)
class Attack:
    """One input."""

    kind: str
    name: str
    held: Held


def inputs(flood: int) -> list[Attack]:
    """Everything that is tried."""
    found = [Attack("request", n, _request(data)) for n, data in REQUESTS.items()]
    found += [Attack("inner port", n, held) for n, held in _INNER.items()]
    found += [Attack("foreign message", n, _closes(d)) for n, d in FOREIGN.items()]
    found += [Attack("wrong message", n, _closes(data)) for n, data in WRONG.items()]
    found += [Attack("unknown element", n, _ignored(d)) for n, d in UNKNOWN.items()]
    found += [Attack("wrong value", n, held) for n, held in _VALUES.items()]
    found += [Attack("order of events", n, held) for n, held in _ORDERS.items()]
    found += [Attack("waiting connections", n, h) for n, h in crowds().items()]
    found += [Attack("flood", n, held) for n, held in floods(flood).items()]
    found += [Attack("greed", n, held) for n, held in greed().items()]
    return found


def _request(data: bytes) -> Held:
    async def held(field: Ground) -> str:
        told = await field.raw(data)
        status = told.split(b" ", 2)[1:2]
        if status and status[0].startswith(b"5") and status[0] != b"505":
            return f"status {status[0].decode()}"
        return "the page, without a login" if b"<title>gaitpref - " in told else ""

    return held


def _closes(data: bytes | str) -> Held:
    async def held(field: Ground) -> str:
        target = await field.open()
        await target.send(data)
        code = await target.closed(within_s=5.0)
        return "" if code is not None else "the sender's page stays open"

    return held


def _ignored(data: bytes) -> Held:
    async def held(field: Ground) -> str:
        target = await field.open(camera=True)
        await target.until_there()
        await target.send(data)
        code = await target.closed(within_s=0.2)
        await target.close()
        return "" if code is None else f"the page was closed ({code})"

    return held


def _value(label: str, value: Any, *, closes: bool) -> Held:
    """Give an element of the own page a value it cannot have."""

    async def held(field: Ground) -> str:
        target = await field.open(camera=True)
        uuid = await target.element(label)
        update = {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}}
        await target.send(msgspec.msgpack.encode(update))
        code = await target.closed(within_s=5.0 if closes else 0.2)
        await target.close()
        return "" if (code is not None) == closes else f"closed: {code}"

    return held


_VALUES: dict[str, Held] = {
    "text for the slider": _value("time, s", "x", closes=True),
    "truth for the slider": _value("time, s", True, closes=True),
    "time before the start": _value("time, s", -1.0, closes=False),
    "time after the end": _value("time, s", 1e8, closes=False),
    "number for the note": _value("note", 7, closes=True),
    "truth for the note": _value("note", False, closes=True),
    "unknown confidence": _value("how sure", "certain", closes=True),
    "number for the confidence": _value("how sure", 1, closes=True),
    "unknown clock button": _value("clock", "explode", closes=True),
    "number for the clock": _value("clock", 0, closes=True),
    "button that is not pressed": _value("A better [2]", False, closes=True),
    "button of a number": _value("A better [2]", 1, closes=True),
    "button of text": _value("Undo [Z]", "yes", closes=True),
    "note of a megabyte": _value("note", "x" * 1_000_000, closes=False),
}


async def _knock_inside(field: Ground, **headers: str) -> str:
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    try:
        socket = await field.browser.ws_connect(
            f"http://127.0.0.1:{field.inner_port}/",
            protocols=("viser-v1.1.1",),
            headers=named,
        )
    except aiohttp.WSServerHandshakeError as error:
        return "" if error.status == 403 else f"status {error.status}"
    await socket.close()
    return "viser took the connection"


async def _inner_get(field: Ground, path: str) -> str:
    async with field.browser.get(f"http://127.0.0.1:{field.inner_port}{path}") as got:
        return "" if got.status == 403 else f"status {got.status}"


async def _inner_silence(field: Ground) -> str:
    return await field.crowd(CROWD, b"", port=field.inner_port)


_INNER: dict[str, Held] = {
    "silence": _inner_silence,
    "a socket": lambda field: _knock_inside(field),
    "a foreign page": lambda f: _knock_inside(f, Origin="http://evil.example"),
    "a rater's name": lambda field: _knock_inside(field, X_Rater="honest"),
    "no secret": lambda f: _knock_inside(f, X_Rater="honest", X_Proxy_Secret=""),
    "a wrong secret": lambda f: _knock_inside(f, X_Proxy_Secret="x" * 43),
    "a long secret": lambda f: _knock_inside(f, X_Proxy_Secret="x" * 8000),
    "a made-up visit": lambda f: _knock_inside(f, X_Visit="x" * 22),
    "its page": lambda field: _inner_get(field, "/"),
    "its file": lambda field: _inner_get(field, "/index.html"),
    "a file beside": lambda field: _inner_get(field, "/%2e%2e/_viser.py"),
}


def _at_once(then: Callable[[Ground, str], Awaitable[None]], *, left: int) -> Held:
    """Open thirty pages of one rater at the same moment, and do something."""

    async def held(field: Ground) -> str:
        rater = field.new_rater()
        opening = [
            asyncio.create_task(field.open(rater, camera=True)) for _ in range(30)
        ]
        await then(field, rater)
        opened = await asyncio.gather(*opening, return_exceptions=True)
        targets = [target for target in opened if isinstance(target, Target)]
        await asyncio.sleep(1.0)
        open_now = [target for target in targets if not target.is_closed]
        for target in open_now:
            # What cannot be sent was not let in.
            with suppress(ConnectionError, AssertionError, TimeoutError):
                await asyncio.wait_for(target.answer(), 1.0)
        stored = field.stored(rater) if left == 0 else 0
        for target in targets:
            await target.close()
        if len(open_now) > left:
            return f"{len(open_now)} pages are open"
        return f"{stored} answers of who is out are stored" if stored else ""

    return held


async def _nothing(field: Ground, rater: str) -> None:
    del field, rater


def _revokes(after_s: float) -> Callable[[Ground, str], Awaitable[None]]:
    async def then(field: Ground, rater: str) -> None:
        await asyncio.sleep(after_s)
        await asyncio.to_thread(field.tokens.revoke, rater)

    return then


def _logs_out(after_s: float) -> Callable[[Ground, str], Awaitable[None]]:
    async def then(field: Ground, rater: str) -> None:
        await asyncio.sleep(after_s)
        await field.log_out(rater)

    return then


async def _answers_after(field: Ground) -> str:
    """A rater answers at the very moment the token goes."""
    rater = field.new_rater()
    target = await field.open(rater, camera=True)
    await target.until_there()
    await asyncio.sleep(0.7)
    await asyncio.to_thread(field.tokens.revoke, rater)
    await target.answer()
    await asyncio.sleep(0.5)
    await target.close()
    return "the answer is stored" if field.stored(rater) else ""


_ORDERS: dict[str, Held] = {
    "thirty at once": _at_once(_nothing, left=1),
    **{
        f"revoked after {delay_s:g} s": _at_once(_revokes(delay_s), left=0)
        for delay_s in (0.0, 0.005, 0.02, 0.05, 0.1, 0.3, 1.0)
    },
    **{
        f"logged out after {delay_s:g} s": _at_once(_logs_out(delay_s), left=0)
        for delay_s in (0.0, 0.005, 0.02, 0.05, 0.1, 0.3, 1.0)
    },
    "answered after the revocation": _answers_after,
}
