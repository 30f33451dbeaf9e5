"""A server that is stopped while pages are open ends without a word of a fault."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import socket
import subprocess
from functools import partial
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from benchmarks.visitor import Visitor
from benchmarks.walks import walking_dataset
from labeling_ui.web.front_door import FrontDoor
from labeling_ui.web.tokens import TokenStore
from tests.helpers.ended_server import ends_well

STAYING, COMING = 4, 4
LIMIT_S = 60.0


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_open_pages_and_those_just_coming_leave_no_traceback(
    tmp_path: Path, number: signal.Signals
) -> None:
    """Some pages play, some are opened and closed all the time, as after an outage."""
    root = tmp_path / "set"
    walking_dataset(root, pairs=30)
    store = TokenStore(root)
    tokens = [store.add(f"rater{index}") for index in range(STAYING + COMING)]
    ends_well(
        ["label", "--dataset", root],
        partial(_stopped, tokens=tokens, number=number),
        limit_s=LIMIT_S,
    )


def test_watch_ends_while_pages_ask(tmp_path: Path) -> None:
    """About a run that has not begun; some ask right now, one holds its connection."""
    ends_well(["watch", tmp_path / "run"], _watched, limit_s=LIMIT_S)


def test_who_comes_in_the_moment_the_door_shuts_leaves_no_error() -> None:
    """Only once the door has begun to shut is it seen that somebody came."""
    faults: list[dict[str, Any]] = []

    async def come() -> None:
        asyncio.get_running_loop().set_exception_handler(
            lambda _, at: faults.append(at)
        )
        door = FrontDoor(asyncio.Protocol)
        port = await door.open("127.0.0.1", 0, None)
        await asyncio.sleep(0)
        shutting = asyncio.create_task(door.close())
        with socket.create_connection(("127.0.0.1", port)):
            await shutting

    asyncio.run(come())
    assert faults == []


async def _watched(server: subprocess.Popen[str], url: str) -> None:
    async def ask(session: aiohttp.ClientSession) -> None:
        while True:
            async with session.get(url + "state.json") as response:
                await response.read()

    async with asyncio.timeout(LIMIT_S), aiohttp.ClientSession() as session:
        async with session.get(url + "state.json") as response:
            assert (await response.json())["kind"] == "empty"
        asking = [asyncio.create_task(ask(session)) for _ in range(STAYING)]
        await asyncio.sleep(0.3)
        server.terminate()
        ended = await asyncio.gather(*asking, return_exceptions=True)
    assert all(isinstance(why, aiohttp.ClientError) for why in ended), ended


async def _stopped(
    server: subprocess.Popen[str], url: str, tokens: list[str], number: signal.Signals
) -> None:
    staying = [Visitor(url, token) for token in tokens[:STAYING]]
    async with asyncio.timeout(LIMIT_S):
        pages = [asyncio.create_task(visitor.run()) for visitor in staying]
        for visitor in staying:
            await visitor.until_moving()
        restless = [asyncio.create_task(_coming(url, t)) for t in tokens[STAYING:]]
        await asyncio.sleep(0.7)
        server.send_signal(number)
        await asyncio.gather(*pages, return_exceptions=True)
        for task in restless:
            task.cancel()
        await asyncio.gather(*restless, return_exceptions=True)
    assert [visitor.close_code for visitor in staying] == [1001] * STAYING


async def _coming(url: str, token: str) -> None:
    """Open the page, leave a moment later, and come again."""
    while True:
        with contextlib.suppress(aiohttp.ClientError, OSError, TimeoutError):
            async with asyncio.timeout(0.3):
                await Visitor(url, token).run()
