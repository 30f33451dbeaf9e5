"""Where the page is attacked: a server, an honest rater, and how harm shows."""

from __future__ import annotations

import asyncio
import itertools
import sqlite3
import subprocess
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, closing, suppress
from pathlib import Path

import aiohttp
import msgspec

from benchmarks.visitor import CAMERA
from benchmarks.walks import walking_dataset
from labeling_ui.web.tokens import TokenStore

from .rater import Honest, Target

OPEN_FILES = 256
MORE_MB = 150.0
"""How much the server may grow by over all attacks."""
MORE_LOG_BYTES = 200_000
MOST_TOLD = 2000
"""Characters of a traceback that a result shows."""
_RATERS = 16
_NEVER_S = 9_999_999_999


class Ground:
    """A server under attack."""

    def __init__(
        self, root: Path, process: subprocess.Popen[str], url: str, slow_s: float
    ) -> None:
        self.tokens = TokenStore(root)
        self.url, self.port = url, int(url.rpartition(":")[2])
        self.slow_s = slow_s
        self._root, self._process = root, process
        self._log = root.parent / "log"
        self._names = itertools.count()
        self._raters = [self.new_rater() for _ in range(_RATERS)]
        self._turn = itertools.cycle(self._raters)
        self._keys = itertools.cycle(("A better", "B better", "Equally good"))
        self._answered_at = 0.0
        self._tracebacks = 0

    async def begin(self, browser: aiohttp.ClientSession, token: str) -> None:
        """Let the honest rater sit down."""
        self.browser = browser
        self._honest = Honest(self.url, token)
        self._page = asyncio.create_task(self._honest.run())
        async with asyncio.timeout(60):
            await self._honest.until_moving()
        await self._honest.press("Close the dialog")
        self._answered_at = time.monotonic()
        await self.answer_s()
        self._begin_mb = self._memory_mb()
        ports = _listening(self._process.pid)
        (self.inner_port,) = ports - {self.port}

    def end(self) -> None:
        """Let everybody go."""
        self._page.cancel()

    def new_rater(self) -> str:
        """Somebody with a token."""
        name = f"attacker{next(self._names)}"
        self.tokens.add(name)
        return name

    def stored(self, rater: str) -> int:
        """Answers of a rater in the data base."""
        file = f"file:{self._root / 'preferences.sqlite'}?mode=ro"
        with closing(sqlite3.connect(file, uri=True)) as base:
            query = "SELECT count(*) FROM answer WHERE rater_id = ?"
            return base.execute(query, (rater,)).fetchone()[0]

    async def open(self, rater: str | None = None, *, camera: bool = False) -> Target:
        """Open a page of an attacker."""
        rater = next(self._turn) if rater is None else rater
        socket = await self.browser.ws_connect(
            f"{self.url}/",
            protocols=("viser-v1.1.1",),
            headers={"Origin": self.url, "Cookie": self._cookie(rater)},
            max_msg_size=0,
        )
        target = Target(self.url, socket)
        if camera:
            with suppress(ConnectionError):
                await target.send(msgspec.msgpack.encode(CAMERA))
        return target

    async def log_out(self, rater: str) -> None:
        """Log a rater out."""
        async with self.browser.post(
            f"{self.url}/logout",
            headers={"Origin": self.url, "Cookie": self._cookie(rater)},
            allow_redirects=False,
        ) as response:
            response.raise_for_status()

    async def get(self, path: str, rater: str) -> int:
        """Ask for a page as a rater; gives the status."""
        headers = {"Cookie": self._cookie(rater)}
        async with self.browser.get(self.url + path, headers=headers) as response:
            await response.read()
            return response.status

    async def raw(self, data: bytes) -> bytes:
        """Send bytes on a connection of their own; gives the begin of the answer."""
        reader, writer = await asyncio.open_connection("127.0.0.1", self.port)
        told = b""
        with suppress(ConnectionError, TimeoutError):
            writer.write(data.replace(b"HOST", f"127.0.0.1:{self.port}".encode()))
            await asyncio.wait_for(writer.drain(), 2.0)
            told = await asyncio.wait_for(reader.read(65536), 0.5)
        await _left(writer)
        return told

    async def crowd(self, count: int, data: bytes, *, port: int) -> str:
        """Open `count` connections that send only this; a new rater still gets in."""
        data = data.replace(b"HOST", f"127.0.0.1:{self.port}".encode())
        before = self._log.stat().st_size
        writers = []
        for _ in range(count):
            with suppress(OSError, TimeoutError):
                opening = asyncio.open_connection("127.0.0.1", port)
                _, writer = await asyncio.wait_for(opening, 2.0)
                writer.write(data)
                writers.append(writer)
        begin = time.monotonic()
        target = await self.open(camera=True)
        async with asyncio.timeout(10):
            await target.until_there()
        entered_s = time.monotonic() - begin
        answered_s = await self.answer_s()
        await asyncio.gather(*(_left(writer) for writer in writers))
        await target.close()
        if self._log.stat().st_size - before > MORE_LOG_BYTES / 10:
            return "the log grew"
        if answered_s > self.slow_s:
            return f"an answer took {answered_s:.2f} s"
        return f"a new rater waited {entered_s:.1f} s" if entered_s > 3.0 else ""

    async def answer_s(self) -> float:
        """Let the honest rater answer; gives how long it took to be on the page."""
        # A pair is looked at for a moment, and no answer follows a like one at once.
        await asyncio.sleep(max(0.0, self._answered_at + 1.2 - time.monotonic()))
        before = self._honest.answered or 0
        pressed = await self._honest.press(next(self._keys))
        async with asyncio.timeout(20):
            self._answered_at = await self._honest.until_answered(before + 1)
        return self._answered_at - pressed

    async def harm(self) -> str:
        """What one input did to others; empty if nothing."""
        if self._process.poll() is not None:
            return "the server died"
        if self._page.done():
            return "the honest rater's page was closed"
        if self._honest.marked:
            self._honest.marked = False
            return "it reached the honest rater's page"
        _, *found = self._log.read_text(errors="replace").split("Traceback")
        if len(found) > self._tracebacks:
            told = found[self._tracebacks].strip()
            self._tracebacks = len(found)
            return f"a traceback in the log: ...{told[-MOST_TOLD:]}"
        if self._memory_mb() > self._begin_mb + MORE_MB:
            return f"the server grew to {self._memory_mb():.0f} MB"
        begin = time.monotonic()
        async with self.browser.get(f"{self.url}/healthz") as response:
            response.raise_for_status()
        return "the server is slow" if time.monotonic() - begin > 1.0 else ""

    async def harm_at_the_end(self) -> str:
        """What all of them together did."""
        if (took_s := await self.answer_s()) > self.slow_s:
            return f"an answer takes {took_s:.2f} s"
        size = self._log.stat().st_size
        return f"the log holds {size} bytes" if size > MORE_LOG_BYTES else ""

    def _cookie(self, rater: str) -> str:
        signature = self.tokens.signature(rater, str(_NEVER_S))
        return f"gaitpref-{self.port}={rater}.{_NEVER_S}.{signature}"

    def _memory_mb(self) -> float:
        status = Path(f"/proc/{self._process.pid}/status").read_text()
        return int(status.partition("VmRSS:")[2].split()[0]) / 1024


async def _left(writer: asyncio.StreamWriter) -> None:
    """Close a connection, whatever became of it."""
    writer.close()
    with suppress(ConnectionError):
        await writer.wait_closed()


def _listening(pid: int) -> set[int]:
    """Ports a process listens on."""
    inodes = set()
    for link in Path(f"/proc/{pid}/fd").iterdir():
        with suppress(OSError):
            inodes.add(str(link.readlink()).removeprefix("socket:[").removesuffix("]"))
    lines = Path(f"/proc/{pid}/net/tcp").read_text().splitlines()[1:]
    rows = [line.split() for line in lines]
    return {
        int(r[1].rpartition(":")[2], 16)
        for r in rows
        if r[3] == "0A" and r[9] in inodes
    }


@asynccontextmanager
async def ground(folder: Path, slow_s: float) -> AsyncIterator[Ground]:
    """A server with few open files, up while the context lasts."""
    root = folder / "set"
    walking_dataset(root, pairs=400, clip_steps=60, steps=300)
    token = TokenStore(root).add("honest")
    command = [
        sys.executable,
        "-m",
        "gaitpref",
        "label",
        "--dataset",
        str(root),
    ]
    limited = ["sh", "-c", f'ulimit -n {OPEN_FILES} && exec "$@"', "sh"]
    with (folder / "log").open("w") as log:
        process = subprocess.Popen(
            [*limited, *command, "--port", "0"],
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
        )
    assert process.stdout is not None
    try:
        lines = iter(process.stdout.readline, "")
        url = next(line for line in lines if "page is at" in line).split()[-1]
        async with aiohttp.ClientSession() as browser:
            field = Ground(root, process, url, slow_s)
            await field.begin(browser, token)
            try:
                yield field
            finally:
                field.end()
    finally:
        process.terminate()
        try:
            process.wait(timeout=20)
        finally:
            process.kill()
            process.stdout.close()
