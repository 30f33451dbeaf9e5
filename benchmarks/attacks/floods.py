"""What a rater, or a stranger, does too often: connections, messages, requests."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

import aiohttp
import msgspec

from .ground import Ground, Target
from .inputs import HALF, UNKNOWN

FLOOD = 5000
CROWD = 300
Held = Callable[[Ground], Awaitable[str]]
"""Does something; gives what got through, empty where nothing did."""
_Make = Callable[[Target], Awaitable[list[bytes]]]
_Act = Callable[[Ground, str], Awaitable[None]]


def crowds() -> dict[str, Held]:
    """Connections that do not say what they want."""
    return {name: _crowd(data) for name, data in HALF.items()}


def floods(count: int) -> dict[str, Held]:
    """Messages of one page, `count` of each kind."""
    return {name: _flood(make, count) for name, make in _FLOODS.items()}


def greed() -> dict[str, Held]:
    """Requests without end."""
    return {name: _greed(act) for name, act in _GREED.items()}


def _crowd(data: bytes) -> Held:
    async def held(field: Ground) -> str:
        return await field.crowd(CROWD, data, port=field.port)

    return held


def _flood(make: _Make, count: int) -> Held:
    """One rater sends without end while the honest one answers."""

    async def held(field: Ground) -> str:
        target = await field.open(camera=True)
        await target.until_there()
        messages = await make(target)

        async def send() -> None:
            with suppress(ConnectionError):
                for number in range(count):
                    await target.send(messages[number % len(messages)])

        sending = asyncio.create_task(send())
        begin, slowest_s = time.monotonic(), 0.0
        while time.monotonic() - begin < min(5.0, count / 200):
            slowest_s = max(slowest_s, await field.answer_s())
        closed = await target.closed(within_s=15.0) if count >= FLOOD else 0
        sending.cancel()
        await target.close()
        if slowest_s > field.slow_s:
            return f"an answer of another rater took {slowest_s:.2f} s"
        return "" if closed is not None else "the flooder's page stays open"

    return held


def _pressing(*names: str) -> _Make:
    async def make(target: Target) -> list[bytes]:
        return [await target.command(name) for name in names]

    return make


def _changing(label: str, *values: Any) -> _Make:
    async def make(target: Target) -> list[bytes]:
        uuid = await target.element(label)
        update: dict[str, Any] = {"type": "GuiUpdateMessage", "uuid": uuid}
        return [
            msgspec.msgpack.encode(update | {"updates": {"value": v}}) for v in values
        ]

    return make


async def _looking(target: Target) -> list[bytes]:
    del target
    return [UNKNOWN["far camera"], UNKNOWN["camera without a screen"]]


_FLOODS: dict[str, _Make] = {
    "undos": _pressing("Undo"),
    "plots": _pressing("Plots"),
    "answers": _pressing("A better", "B better", "Equally good"),
    "views": _pressing("Other view"),
    "themes": _pressing("Light or dark"),
    "dialogs": _pressing("Guidelines", "Close the dialog"),
    "steps": _pressing("Step on", "Step back"),
    "speeds": _pressing("Slower", "Faster", "Play or pause", "Replay"),
    "camera": _looking,
    "slider": _changing("time, s", 0.1, 0.5, 0.9),
    "notes": _changing("note", "x" * 60_000, "y" * 60_000),
    "history": _changing("Undo [Z]", True),
}


def _greed(act: _Act) -> Held:
    """One rater, or a stranger, asks again and again, twenty times at once."""

    async def held(field: Ground) -> str:
        rater = field.new_rater()

        async def again() -> None:
            while True:
                with suppress(aiohttp.ClientError, ConnectionError):
                    await act(field, rater)
                await asyncio.sleep(0)

        tasks = [asyncio.create_task(again()) for _ in range(20)]
        slowest_s = max([await field.answer_s() for _ in range(3)])
        for task in tasks:
            task.cancel()
        ended = await asyncio.gather(*tasks, return_exceptions=True)
        failed = [e for e in ended if not isinstance(e, asyncio.CancelledError)]
        if failed:
            return f"{failed[0]!r}"
        if slowest_s > field.slow_s:
            return f"an answer of another rater took {slowest_s:.2f} s"
        return ""

    return held


def _asks(path: str) -> _Act:
    async def act(field: Ground, rater: str) -> None:
        await field.get(path, rater)

    return act


async def _opens(field: Ground, rater: str) -> None:
    target = await field.open(rater, camera=True)
    await target.closed(within_s=0.1)
    await target.close()


async def _guesses(field: Ground, rater: str) -> None:
    headers = {"Origin": field.url}
    form = {"token": rater}
    async with field.browser.post(f"{field.url}/login", data=form, headers=headers):
        pass


_GREED: dict[str, _Act] = {
    "opens pages": _opens,
    "asks for the page": _asks("/"),
    "asks for figures": _asks("/figures"),
    "asks for guidelines": _asks("/guidelines"),
    "asks for what there is not": _asks("/nothing"),
    "guesses tokens": _guesses,
}
