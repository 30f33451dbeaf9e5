"""Attacks on the labeling page: `python -m benchmarks.attack_page [--quick]`.

A server runs in a process of its own, on loopback, with 256 open files. One honest
rater sits at it all the time; every input is followed by a look at that page, at the
log and at what is stored. A table tells how many inputs of each kind were held.
"""

from __future__ import annotations

import asyncio
import json
import tempfile
import time
from collections import Counter
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import aiohttp
import msgspec
import tyro

from .attack_ground import Ground, Target, ground
from .attack_inputs import FOREIGN, HALF, REQUESTS, UNKNOWN, WRONG

FLOOD = 5000
CROWD = 300
Held = Callable[[Ground], Awaitable[str]]
"""Does something; gives what got through, empty where nothing did."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Attack the labeling page."""

    quick: bool = False
    """A few inputs of each kind, and smaller floods."""
    slow_s: float = 0.2
    """An answer of another rater is on the page again within so long, always."""
    json: Path | None = None
    """File for the counts."""


@dataclass(frozen=True, kw_only=True)
class Result:
    """What became of one input."""

    kind: str
    name: str
    got_through: str
    """Empty where it was held."""


@dataclass(frozen=True)
class Attack:
    """One input."""

    kind: str
    name: str
    held: Held


def main(options: Options) -> list[Result]:
    """Attack, print the table and write the counts."""
    results = asyncio.run(_all(options.quick, options.slow_s))
    counts = Counter(result.kind for result in results)
    through = Counter(result.kind for result in results if result.got_through)
    print(f"{'kind':<24}{'inputs':>8}{'held':>8}{'got through':>14}")
    for kind, count in (*counts.items(), ("all", counts.total())):
        got = through.total() if kind == "all" else through[kind]
        print(f"{kind:<24}{count:>8}{count - got:>8}{got:>14}")
    for result in results:
        if result.got_through:
            print(f"  {result.kind}, {result.name}: {result.got_through}")
    if options.json is not None:
        options.json.write_text(json.dumps([asdict(result) for result in results]))
    return results


async def _all(quick: bool, slow_s: float) -> list[Result]:
    attacks = inputs(FLOOD // 5 if quick else FLOOD)
    if quick:
        seen: Counter[str] = Counter()
        few = []
        for attack in attacks:
            seen[attack.kind] += 1
            if seen[attack.kind] <= _QUICK.get(attack.kind, 3):
                few.append(attack)
        attacks = few
    results = []
    with tempfile.TemporaryDirectory() as folder:
        async with ground(Path(folder), slow_s) as field:
            for attack in attacks:
                try:
                    async with asyncio.timeout(90):
                        got = await attack.held(field) or await field.harm()
                except Exception as error:
                    got = f"{type(error).__name__}: {error}"
                print(f"{attack.kind}, {attack.name}: {got or 'held'}", flush=True)
                results.append(
                    Result(kind=attack.kind, name=attack.name, got_through=got)
                )
            if got := await field.harm_at_the_end():
                results.append(Result(kind="in the end", name="all", got_through=got))
    return results


_QUICK = {"flood": 2, "greed": 1, "waiting connections": 2, "order of events": 4}


def inputs(flood: int) -> list[Attack]:
    """Everything that is tried."""
    found = [Attack("request", n, _request(data)) for n, data in REQUESTS.items()]
    found += [Attack("inner port", n, held) for n, held in _INNER.items()]
    found += [Attack("foreign message", n, _closes(d)) for n, d in FOREIGN.items()]
    found += [Attack("wrong message", n, _closes(data)) for n, data in WRONG.items()]
    found += [Attack("unknown element", n, _ignored(d)) for n, d in UNKNOWN.items()]
    found += [Attack("wrong value", n, held) for n, held in _VALUES.items()]
    found += [Attack("order of events", n, held) for n, held in _ORDERS.items()]
    found += [Attack("waiting connections", n, _crowd(d)) for n, d in HALF.items()]
    found += [Attack("flood", n, _flood(make, flood)) for n, make in _FLOODS.items()]
    found += [Attack("greed", n, _greed(act)) for n, act in _GREED.items()]
    return found


def _request(data: bytes) -> Held:
    async def held(field: Ground) -> str:
        told = await field.raw(data)
        status = told.split(b" ", 2)[1:2]
        if status and status[0].startswith(b"5") and status[0] != b"505":
            return f"status {status[0].decode()}"
        return "the page, without a login" if b"<title>Viser" in told else ""

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
    "unknown confidence": _value("you are", "certain", closes=True),
    "number for the confidence": _value("you are", 1, closes=True),
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
    "silence": _inner_silence,
}


def _crowd(data: bytes) -> Held:
    async def held(field: Ground) -> str:
        return await field.crowd(CROWD, data, port=field.port)

    return held


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


def _flood(make: Callable[[Target], Awaitable[list[bytes]]], count: int) -> Held:
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


def _pressing(*names: str) -> Callable[[Target], Awaitable[list[bytes]]]:
    async def make(target: Target) -> list[bytes]:
        return [await target.command(name) for name in names]

    return make


def _changing(label: str, *values: Any) -> Callable[[Target], Awaitable[list[bytes]]]:
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


_FLOODS: dict[str, Callable[[Target], Awaitable[list[bytes]]]] = {
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


def _greed(act: Callable[[Ground, str], Awaitable[None]]) -> Held:
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


def _asks(path: str) -> Callable[[Ground, str], Awaitable[None]]:
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


_GREED: dict[str, Callable[[Ground, str], Awaitable[None]]] = {
    "opens pages": _opens,
    "asks for the page": _asks("/"),
    "asks for figures": _asks("/figures"),
    "asks for guidelines": _asks("/guidelines"),
    "asks for what there is not": _asks("/nothing"),
    "guesses tokens": _guesses,
}


if __name__ == "__main__":
    main(tyro.cli(Options))
