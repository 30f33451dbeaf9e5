"""Joins a browser's socket to one of viser's."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any

from aiohttp import ClientWebSocketResponse, WSMsgType, web

CLOSE_BROKEN = 1011


async def pump(
    from_browser: Coroutine[Any, Any, None],
    browser: web.WebSocketResponse,
    viser: ClientWebSocketResponse,
) -> None:
    """Carry messages both ways until one side ends; then end the other."""
    tasks = [
        asyncio.create_task(from_browser),
        asyncio.create_task(_from_viser(browser, viser)),
    ]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    if viser.closed and not browser.closed:
        code = viser.close_code or CLOSE_BROKEN
        # 1006 says that nothing was said, and must not itself be said.
        await browser.close(code=CLOSE_BROKEN if code == 1006 else code)


async def _from_viser(
    browser: web.WebSocketResponse, viser: ClientWebSocketResponse
) -> None:
    async for message in viser:
        if message.type is WSMsgType.BINARY:
            await browser.send_bytes(message.data)
