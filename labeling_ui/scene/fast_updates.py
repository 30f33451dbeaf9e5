"""Where things are, on their way to the browser, fifty times a second.

viser's setters convert and compare what they are given, and take two messages for what
moves and turns; its messages find out anew what each value is.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
from viser import ClientHandle, SceneApi

# The private name: nothing public moves and turns a mesh in one message.
from viser._messages import SceneNodeUpdateMessage

_WINDOW_S = 1 / 40
"""How long viser waits for more before it sends what was not sent at once. Longer than
from one frame to the next, so that it does not wake up between them for nothing."""


class _Moved(SceneNodeUpdateMessage):
    """An update of which everything is known beforehand but the numbers."""

    def __init__(self, name: str, key: str, arrays: dict[str, np.ndarray]) -> None:
        super().__init__(name, arrays)
        self._key = key

    def redundancy_key(self) -> str:
        return self._key

    def as_serializable_dict(
        self, binary_buffers: list[memoryview] | None = None
    ) -> dict[str, Any]:
        updates: dict[str, Any] = {}
        for name, array in self.updates.items():
            if binary_buffers is None:
                updates[name] = array.data
                continue
            updates[name] = {"__binary_index": len(binary_buffers), "dtype": "<f4"}
            binary_buffers.append(array.data)
        return {
            "type": SceneNodeUpdateMessage.__name__,
            "name": self.name,
            "updates": updates,
            "owner": self.owner,
        }


class Frames:
    """Sends what moves in one frame at once, and wakes viser's thread once for it."""

    def __init__(self, client: ClientHandle) -> None:
        self._buffer = client._websock_connection.get_message_buffer()
        self._buffer.window_duration_sec = _WINDOW_S

    @contextmanager
    def frame(self) -> Iterator[None]:
        """What is moved in the block is seen together, without delay."""
        self._buffer.atomic_start()
        try:
            yield
        finally:
            # `atomic` and `flush` would each wake the other thread, which then holds
            # the interpreter while this one has yet to finish.
            with suppress(RuntimeError):  # The server has stopped.
                self._buffer.event_loop.call_soon_threadsafe(self._release)

    def _release(self) -> None:
        self._buffer.atomic_end()
        self._buffer.flush_event.set()


class Mover:
    """Moves the instances of one batched node of one client."""

    def __init__(self, scene: SceneApi, name: str) -> None:
        self._scene, self._name = scene, name
        # Of two updates that wait to be sent, the newer one replaces the other.
        self._key = f"moved:{name}"

    def move(self, positions: np.ndarray, wxyzs: np.ndarray | None = None) -> None:
        """Put the instances at `positions` [I, 3] m, turned by `wxyzs` [I, 4].

        Args:
            positions: float32, as is `wxyzs`; neither may change any more.
            wxyzs: None leaves them turned as they are.
        """
        arrays = {"batched_positions": positions}
        if wxyzs is not None:
            arrays["batched_wxyzs"] = wxyzs
        self._scene._queue_scene_message(_Moved(self._name, self._key, arrays))
