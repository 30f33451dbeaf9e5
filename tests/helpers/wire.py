"""A line between a browser and a server that can be cut, or go dead without a word."""

from __future__ import annotations

import select
import socket
import threading
from collections.abc import Callable
from contextlib import suppress

_POLL_S = 0.05


class Wire:
    """Forwards connections to a port of this machine, until it is cut."""

    def __init__(self, port: int) -> None:
        self._to = port
        self._threads: list[threading.Thread] = []
        self.port = 0
        self.holds_sockets = False
        """Whether no new WebSocket comes through, as on a line that is slow."""
        self.join()

    @property
    def url(self) -> str:
        """Where the server seems to be."""
        return f"http://127.0.0.1:{self.port}"

    def join(self) -> None:
        """Take connections in, at the port as before."""
        listening = socket.create_server(("127.0.0.1", self.port))
        self.port = listening.getsockname()[1]
        self._whole, self._dead = threading.Event(), threading.Event()
        self._held = threading.Event()
        self._whole.set()
        self._held.set()
        self._start(self._accept, listening, self._whole)

    def cut(self) -> None:
        """End all connections, and take in no more."""
        self._whole.clear()
        for thread in self._threads:
            thread.join()
        self._threads.clear()

    def deaden(self) -> None:
        """Carry nothing any more on the connections there are, and end none."""
        self._dead.set()
        self._dead = threading.Event()

    def _start(self, work: Callable[..., None], *arguments: object) -> None:
        thread = threading.Thread(target=work, args=arguments, daemon=True)
        self._threads.append(thread)
        thread.start()

    def _accept(self, listening: socket.socket, whole: threading.Event) -> None:
        with listening:
            listening.settimeout(_POLL_S)
            while whole.is_set():
                with suppress(TimeoutError):
                    browser, _ = listening.accept()
                    self._start(self._carry, browser, whole, self._dead)

    def _carry(
        self, browser: socket.socket, whole: threading.Event, dead: threading.Event
    ) -> None:
        with browser, suppress(OSError):
            browser.settimeout(None)
            with socket.create_connection(("127.0.0.1", self._to)) as server:
                others = {browser: server, server: browser}
                while whole.is_set():
                    for end in select.select(list(others), [], [], _POLL_S)[0]:
                        data = end.recv(2**16)
                        if not data:
                            return
                        asks = b"upgrade: websocket" in data.lower()
                        if asks and self.holds_sockets:
                            dead = self._held
                        if not dead.is_set():
                            others[end].sendall(data)
