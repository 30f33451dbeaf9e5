"""A Ray to run on: one that runs already, or one that is started here and ends here."""

from __future__ import annotations

import importlib
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from data.errors import GaitprefError

LOCAL, AUTO = "local", "auto"
_CONNECT_S = 5.0
_ANSWER_S = 30.0
_STORE_BYTES = 300 * 2**20
"""Little passes through the store; by default Ray takes a third of the memory."""
_SETTINGS = {
    "RAY_USAGE_STATS_ENABLED": "0",
    # It would warn that a default changes for tasks without a GPU.
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
    # Actors are half of a training: at Ray's niceness of 15 anything else at work here
    # would leave the learner waiting for them.
    "RAY_worker_niceness": "0",
}


class RayError(GaitprefError):
    """No Ray can be used."""


def is_connected() -> bool:
    """Whether this program is connected to a Ray already."""
    ray = sys.modules.get("ray")
    return ray is not None and ray.is_initialized()


@contextmanager
def connected(address: str, *, cores: int) -> Iterator[Any]:
    """The module `ray`, connected while the block runs; a program that is connected
    already stays so. Ray must be installed.

    Args:
        address: HOST:PORT of a cluster this machine belongs to, `auto` for the one that
            runs here, or `local` for one that ends with the block.
        cores: Those of one that is started here.

    Raises:
        RayError: there is none, or it is of other versions.
    """
    for name, value in _SETTINGS.items():
        os.environ.setdefault(name, value)
    ray = importlib.import_module("ray")
    if is_connected():
        # Who has connected before will also end it.
        yield ray
        return
    settings: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}
    if address == LOCAL:
        settings |= {
            "num_cpus": cores,
            "include_dashboard": False,
            "object_store_memory": _STORE_BYTES,
        }
    elif address != AUTO:
        _require_answer(address)
    try:
        with _own_signals():
            ray.init(address=address, **settings)
    except (ConnectionError, RuntimeError, ValueError, SystemExit) as error:
        # What speaks another protocol on that port ends Ray with SystemExit; of other
        # versions it is half connected by now.
        ray.shutdown()
        raise RayError(_reason(error, address)) from None
    try:
        yield ray
    finally:
        ray.shutdown()


@contextmanager
def _own_signals() -> Iterator[None]:
    """Keep what SIGTERM does, which Ray would make the end of the process."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handler = signal.getsignal(signal.SIGTERM)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, handler)


def _require_answer(address: str) -> None:
    """Ask before Ray does, which tries for minutes and then ends the process.

    Raises:
        RayError: what is there is not Ray, or nothing is.
    """
    host, _, port = address.rpartition(":")
    if not (host and port.isdecimal()):
        raise RayError(
            f"--ray takes HOST:PORT, as `ray start --head` prints it, {AUTO} or "
            f"{LOCAL}, got {address!r}"
        )
    try:
        socket.create_connection((host, int(port)), _CONNECT_S).close()
    except (OSError, OverflowError) as error:
        told = getattr(error, "strerror", None) or error
        raise RayError(
            f"no Ray answers at --ray {address} ({told}): `ray start --head --port "
            f"{port}` starts one there"
        ) from None
    # What listens there may be something else.
    asked = [sys.executable, "-m", "ray.scripts.scripts", "health-check"]
    asked += ["--skip-version-check", "--address", address]
    try:
        healthy = not subprocess.run(
            asked, capture_output=True, timeout=_ANSWER_S, check=False
        ).returncode
    except subprocess.TimeoutExpired:
        healthy = False
    if not healthy:
        raise RayError(
            f"what answers at --ray {address} is not Ray, or is busy ending: give the "
            "HOST:PORT that `ray start --head` printed"
        )


def _reason(error: BaseException, address: str) -> str:
    """One line for what Ray says in many."""
    told = " ".join(str(error).split())[:200]
    if "ersion mismatch" in told:
        return (
            f"the Ray at {address} runs other versions than this machine ({told}): "
            "install the same Ray and Python on both"
        )
    if address == LOCAL:
        return f"Ray cannot be started here ({told}): is there memory left?"
    return (
        f"--ray {address} cannot be joined from this machine ({told}): start gaitpref "
        "on a machine of that cluster, after `ray start --address HOST:PORT`, or "
        f"give --ray {LOCAL}"
    )
