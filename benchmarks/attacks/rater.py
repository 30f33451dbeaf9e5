"""Who sits at the attacked page: the honest rater, and the attacker."""

from __future__ import annotations

import asyncio
from contextlib import suppress

import aiohttp
import msgspec
import zstandard

from benchmarks.visitor import Visitor

from .inputs import MARK


class Honest(Visitor):
    """The rater who only answers; notes whether anything of an attacker arrives."""

    marked = False

    def _read(self, frame: bytes, opened: float) -> None:
        size = int.from_bytes(frame[8:16], "little")
        inner = zstandard.ZstdDecompressor().decompress(frame[16 : 16 + size])
        self.marked |= MARK.encode() in inner
        super()._read(frame, opened)


class Target(Visitor):
    """A page of an attacker."""

    def __init__(self, url: str, socket: aiohttp.ClientWebSocketResponse) -> None:
        super().__init__(url, None)
        self._socket = socket
        self._reading = asyncio.create_task(self._follow())

    @property
    def is_closed(self) -> bool:
        """Whether the server has ended the page."""
        return self._socket.closed

    async def send(self, data: bytes | str) -> None:
        """Send these bytes, or this text."""
        if isinstance(data, str):
            await self._socket.send_str(data)
        else:
            await self._socket.send_bytes(data)

    async def closed(self, *, within_s: float) -> int | None:
        """The code the page is closed with; None if it stays open."""
        await asyncio.wait([self._reading], timeout=within_s)
        return self._socket.close_code if self._reading.done() else None

    async def close(self) -> None:
        """Leave."""
        await self._socket.close()
        self._reading.cancel()

    async def until_there(self) -> None:
        """Wait until the page is built."""
        while "A better" not in self._commands:
            await asyncio.sleep(0.01)

    async def command(self, name: str) -> bytes:
        """The message of a hotkey."""
        await self.until_there()
        uuid = self._commands[name]
        return msgspec.msgpack.encode({"type": "CommandTriggerMessage", "uuid": uuid})

    async def element(self, label: str) -> str:
        """The id of an element of the page."""
        while label not in self.elements:
            await asyncio.sleep(0.01)
        return self.elements[label]

    async def answer(self) -> None:
        """Answer what is on the screen."""
        await self.until_there()
        with suppress(ConnectionError):
            await self.send(await self.command("A better"))

    async def _follow(self) -> None:
        async for message in self._socket:
            if message.type is aiohttp.WSMsgType.BINARY:
                self._read(message.data, 0.0)
