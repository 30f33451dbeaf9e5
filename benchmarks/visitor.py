"""A visitor of the labeling page without a browser: decodes every frame it is sent."""

from __future__ import annotations

import asyncio
import re
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import aiohttp
import msgspec
import zstandard
from yarl import URL

_ANSWERED = re.compile(r"(\d+) answered, (\d+) open")
_LOOP = re.compile(r">((?:round \d+ of \d+|the last round): [^<]*)<")
_ATTEMPTS = 5
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (0.0, -3.0, 1.0),
    "fov": 0.7,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 720,
    "image_width": 1280,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}


class Visitor:
    """One rater at the page; answers by the page's own hotkeys."""

    def __init__(
        self,
        url: str,
        token: str | None,
        connector: Callable[[], aiohttp.BaseConnector] | None = None,
        picture: tuple[int, int] = (1280, 720),
    ) -> None:
        """Nobody has come yet.

        Args:
            url: Of the page, without a slash at the end.
            token: Without one there is no login either.
            connector: Makes the way to the server, where it is an unusual one.
            picture: Width and height in which the robots are seen, pixels.
        """
        self._url, self._token, self._connector = url, token, connector
        width, height = picture
        self._camera = {**CAMERA, "image_width": width, "image_height": height}
        self._commands: dict[str, str] = {}
        self.elements: dict[str, str] = {}
        """Ids of sliders, texts and buttons by their labels."""
        self.texts: dict[str, str] = {}
        """What every piece of text on the page says now, by its id."""
        self.moved: Counter[str] = Counter()
        """Poses that came for each robot."""
        self.answered: int | None = None
        """Answers the page has shown."""
        self.open = 0
        """Pairs the page says are open."""
        self.places: dict[str, tuple[float, float, float]] = {}
        """Where what stands still is, m, by its name."""
        self.pose_times: list[float] = []
        """When poses arrived, s of the monotonic clock."""
        self.first_pose_s: float | None = None
        """From opening the page to the first pose."""
        self.dialog_shown = False
        self.close_code: int | None = None
        """Why the page ended, if it did."""
        self.loop: list[str] = []
        """What the loop was doing, one entry a change."""

    async def run(self) -> None:
        """Log in and read until cancelled, or until the server goes away."""
        jar = aiohttp.CookieJar(unsafe=True)
        async with aiohttp.ClientSession(
            cookie_jar=jar,
            headers={"Origin": str(URL(self._url).origin())},
            connector=None if self._connector is None else self._connector(),
        ) as session:
            if self._token is not None:
                login = {"token": self._token}
                async with session.post(self._url + "/login", data=login) as response:
                    response.raise_for_status()
            opened = time.monotonic()
            async with session.get(self._url + "/") as response:
                response.raise_for_status()
            async with await self._connect(session) as socket:
                self._socket = socket
                await self._send(self._camera)
                async for message in socket:
                    if message.type is aiohttp.WSMsgType.BINARY:
                        self._read(message.data, opened)
                self.close_code = socket.close_code

    async def _connect(
        self, session: aiohttp.ClientSession
    ) -> aiohttp.ClientWebSocketResponse:
        """Open the page's socket; tries again, as the page in a browser does."""
        for remaining in reversed(range(_ATTEMPTS)):
            try:
                return await session.ws_connect(
                    self._url, protocols=("viser-v1.1.1",), max_msg_size=0
                )
            except aiohttp.WSServerHandshakeError:
                if not remaining:
                    raise
                await asyncio.sleep(1.0)
        raise AssertionError("unreachable")

    async def press(self, command: str) -> float:
        """Trigger a command by its name, as its hotkey would; gives the time."""
        pressed = time.monotonic()
        uuid = self._commands[command]
        await self._send({"type": "CommandTriggerMessage", "uuid": uuid})
        return pressed

    async def set(self, label: str, value: float | str | bool) -> None:
        """Move a slider, fill in a text or press a button."""
        uuid = self.elements[label]
        updates = {"value": value}
        await self._send({"type": "GuiUpdateMessage", "uuid": uuid, "updates": updates})

    async def until_answered(self, count: int) -> float:
        """Wait until the page shows `count` answers; gives the time."""
        while self.answered is None or self.answered < count:
            await asyncio.sleep(0.002)
        return time.monotonic()

    async def until_moving(self) -> None:
        """Wait for the first poses and commands."""
        while not self.pose_times or "A better" not in self._commands:
            await asyncio.sleep(0.01)

    async def _send(self, message: dict[str, Any]) -> None:
        await self._socket.send_bytes(msgspec.msgpack.encode(message))

    def _read(self, frame: bytes, opened: float) -> None:
        size = int.from_bytes(frame[8:16], "little")
        inner = zstandard.ZstdDecompressor().decompress(frame[16 : 16 + size])
        moved = False
        for message in msgspec.msgpack.decode(inner)["messages"]:
            kind = message["type"]
            if kind == "SceneNodeUpdateMessage":
                if "batched_wxyzs" in message["updates"]:
                    robot = message["name"].split("/")[1]
                    self.moved[robot] += 1
                    moved |= robot == "robot_A"
            elif kind == "SetPositionMessage":
                x, y, z = message["position"]
                self.places[message["name"]] = (x, y, z)
            elif kind == "GuiUpdateMessage":
                self._read_text(message["uuid"], message["updates"].get("content"))
            elif kind == "GuiHtmlMessage":
                self._read_text(message["uuid"], message["props"]["content"])
            elif kind == "RegisterCommandMessage":
                self._commands[message["props"]["label"]] = message["uuid"]
            elif kind == "GuiModalMessage":
                self.dialog_shown = True
            elif kind.startswith("Gui") and "label" in message.get("props", {}):
                self.elements[message["props"]["label"]] = message["uuid"]
        if moved:
            self.pose_times.append(time.monotonic())
            if self.first_pose_s is None:
                self.first_pose_s = self.pose_times[0] - opened

    def _read_text(self, uuid: str, content: Any) -> None:
        if not isinstance(content, str):
            return
        self.texts[uuid] = content
        if found := _ANSWERED.search(content):
            self.answered, self.open = int(found[1]), int(found[2])
        if found := _LOOP.search(content):
            self.loop.append(found[1])
