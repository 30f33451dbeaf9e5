"""A connection to a Ray cluster, or a line that says why there is none."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from data.errors import GaitprefError
from gaitpref.console.extras import require

from .pieces import cores

LOCAL, AUTO = "local", "auto"
_ANSWER_S = 5.0
_STORE_BYTES = 300 * 2**20
"""Only small results pass through the store; by default Ray takes a third of the
memory."""


class ClusterError(GaitprefError):
    """No Ray can be used."""


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """The module `ray`, connected while the block runs; a program that is connected
    already stays so.

    Args:
        address: HOST:PORT of a cluster this machine belongs to, `auto` for the one that
            runs here, or `local` for one of this machine's cores that ends with the
            block.

    Raises:
        ClusterError: there is none, or it is of other versions.
        MissingExtra: Ray is not installed.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    ray = require("ray", "scale")
    if ray.is_initialized():
        yield ray
        return
    settings: dict[str, Any] = {"address": address, "log_to_driver": False}
    if address == LOCAL:
        settings |= {
            "num_cpus": cores(),
            "include_dashboard": False,
            "object_store_memory": _STORE_BYTES,
        }
    elif address != AUTO:
        _require_answer(address)
    try:
        ray.init(**settings)
    except (ConnectionError, RuntimeError, ValueError, SystemExit) as error:
        # What speaks another protocol on that port ends Ray with SystemExit.
        raise ClusterError(
            f"no Ray can be used at {address} ({' '.join(str(error).split())[:300]}): "
            f"`ray start --head` starts one and `ray start --address HOST:PORT` joins "
            f"one, with one version of Ray and of Python on all machines; {LOCAL} "
            f"starts one of this machine's cores"
        ) from None
    try:
        yield ray
    finally:
        ray.shutdown()


def _require_answer(address: str) -> None:
    """Ask before Ray does, which tries for minutes.

    Raises:
        ClusterError: nothing listens there.
    """
    host, _, port = address.rpartition(":")
    if not (host and port.isdecimal()):
        raise ClusterError(
            f"Ray's address must be HOST:PORT, {AUTO} or {LOCAL}, got {address!r}"
        )
    try:
        socket.create_connection((host, int(port)), _ANSWER_S).close()
    except (OSError, OverflowError) as error:
        raise ClusterError(
            f"no Ray answers at {address} ({error}): `ray start --head --port {port}` "
            f"starts one there"
        ) from None
