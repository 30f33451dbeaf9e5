"""Takes the connections of the network in, so that silent ones keep nobody out.

aiohttp waits for a request as long as it takes, and asyncio's own server stops for a
second, with a traceback for each caller, when all files of the process are open.
"""

from __future__ import annotations

import asyncio
import logging
import resource
import socket
import ssl
import time
from collections import Counter
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

from aiohttp import web

from labeling_ui.limits import page_limits as limits

from .checks import address_block

logger = logging.getLogger(__name__)
_SWEEP_S = 1.0
_FULL_S = 0.1
"""How long to wait where a connection can neither be taken nor another closed."""


@dataclass(eq=False)
class _Caller:
    """A connection; `transport` once its encryption is agreed on."""

    address: str
    until_s: float
    socket: socket.socket
    transport: asyncio.BaseTransport | None = None
    on_page: bool = False
    """Whether the connection carries an open page, which alone closes it then."""

    dropped: bool = False

    @property
    def gone(self) -> bool:
        if self.transport is not None:
            return self.dropped or self.transport.is_closing()
        return self.dropped or self.socket.fileno() < 0

    def hang_up(self) -> None:
        self.dropped = True
        if isinstance(self.transport, asyncio.Transport):
            self.transport.abort()
        else:
            with suppress(OSError):
                # What agrees on the encryption reads the end, and closes it.
                self.socket.shutdown(socket.SHUT_RDWR)


class FrontDoor:
    """Listens on a port and keeps a limited number of callers waiting."""

    def __init__(self, serve: Callable[[], asyncio.Protocol]) -> None:
        """A door that is shut until `open`.

        Args:
            serve: Makes what speaks HTTP on one connection.
        """
        self._serve = serve
        self._callers: dict[asyncio.BaseProtocol, _Caller] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        files, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        self._room = limits.WAITING
        if files != resource.RLIM_INFINITY:
            self._room = min(self._room, int(files * limits.WAITING_SHARE))

    async def open(self, host: str, port: int, tls: ssl.SSLContext | None) -> int:
        """Listen; gives the port.

        Raises:
            OSError: the port cannot be opened.
        """
        loop = asyncio.get_running_loop()
        # asyncio knows how to bind to a name with several addresses; it never serves.
        bound = await loop.create_server(
            asyncio.Protocol, host, port, start_serving=False
        )
        self._listening = [listening.dup() for listening in bound.sockets]
        bound.close()
        for listening in self._listening:
            listening.setblocking(False)
            listening.listen(128)
            self._start(self._accept(listening, tls))
        self._start(self._sweep())
        return self._listening[0].getsockname()[1]

    async def close(self) -> None:
        """Take nobody in any more; who is in stays."""
        for task in tuple(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for listening in getattr(self, "_listening", ()):
            listening.close()

    @contextmanager
    def answering(self, request: web.Request, *, on_page: bool) -> Iterator[None]:
        """While a request of a caller is answered, and for some time afterwards."""
        caller = self._callers.get(request.protocol)
        if caller is None:
            yield
            return
        caller.on_page = on_page
        caller.until_s = time.monotonic() + 2 * limits.REQUEST_S
        # To the end of the line: who was heard last is the last to be closed.
        self._callers[request.protocol] = self._callers.pop(request.protocol)
        try:
            yield
        finally:
            caller.on_page = False
            caller.until_s = time.monotonic() + limits.IDLE_S

    async def _accept(
        self, listening: socket.socket, tls: ssl.SSLContext | None
    ) -> None:
        while True:
            await _readable(listening)
            try:
                taken, address = listening.accept()
            except BlockingIOError:
                continue
            except OSError as error:
                logger.error("a connection cannot be taken: %s", error)
                if not self._drop_one():
                    await asyncio.sleep(_FULL_S)
                continue
            taken.setblocking(False)
            until_s = time.monotonic() + limits.REQUEST_S
            caller = _Caller(address_block(address[0]), until_s, taken)
            protocol = self._serve()
            self._callers[protocol] = caller
            while len(self._waiting()) > self._room and self._drop_one():
                pass
            self._start(self._greet(caller, protocol, tls))

    async def _greet(
        self,
        caller: _Caller,
        protocol: asyncio.Protocol,
        tls: ssl.SSLContext | None,
    ) -> None:
        wait_s = None if tls is None else limits.REQUEST_S
        try:
            caller.transport, _ = await asyncio.get_running_loop(
            ).connect_accepted_socket(
                lambda: protocol, caller.socket, ssl=tls, ssl_handshake_timeout=wait_s
            )  # fmt: skip
        except (OSError, TimeoutError) as error:
            logger.debug("%s gave up: %s", caller.address, error)
            caller.socket.close()

    async def _sweep(self) -> None:
        while True:
            await asyncio.sleep(_SWEEP_S)
            now_s = time.monotonic()
            for caller in self._waiting():
                if caller.until_s < now_s:
                    caller.hang_up()

    def _waiting(self) -> list[_Caller]:
        """Who has no open page, the one that was silent for longest first."""
        for protocol in [key for key, caller in self._callers.items() if caller.gone]:
            del self._callers[protocol]
        return [caller for caller in self._callers.values() if not caller.on_page]

    def _drop_one(self) -> bool:
        """Close the oldest connection of the address that has most, if there is one."""
        waiting = self._waiting()
        if not waiting:
            return False
        ((most, _),) = Counter(caller.address for caller in waiting).most_common(1)
        oldest = next(caller for caller in waiting if caller.address == most)
        oldest.hang_up()
        logger.warning("%s has too many silent connections; one is closed", most)
        return True

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        # The event loop itself keeps no hold of a task.
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


async def _readable(waiting: socket.socket) -> None:
    """Until there is something for `waiting`.

    `loop.sock_accept` would do, but Python 3.11 reports an error of its own where it is
    cancelled in the moment in which somebody comes.
    """
    loop, there = asyncio.get_running_loop(), asyncio.Event()
    loop.add_reader(waiting, there.set)
    try:
        await there.wait()
    finally:
        loop.remove_reader(waiting)
