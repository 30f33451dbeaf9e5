"""A Ray to run actors on: one that runs already, or one for this command alone."""

from __future__ import annotations

import importlib
import importlib.metadata
import os
import platform
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .actors_cfg import ActorsCfg, ActorsError

_STORE_BYTES = 300 * 2**20
_CONNECT_S = 5.0
_ANSWER_S = 30.0
_PACKAGES = ("gaitpref", "mujoco", "numpy", "ray", "rsl-rl-lib", "torch")
_QUIET = {
    "RAY_USAGE_STATS_ENABLED": "0",
    # It would warn that a default changes for tasks without a GPU.
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
}


@contextmanager
def ray_for(cfg: ActorsCfg) -> Iterator[Any]:
    """The module `ray`, connected; what was started here ends with it.

    Raises:
        ActorsError: nothing answers at the address, its versions differ, or it has
            fewer cores than there are actors.
    """
    for name, value in _QUIET.items():
        os.environ.setdefault(name, value)
    ray = importlib.import_module("ray")
    if ray.is_initialized():
        # Who has connected before will also end it.
        _require_cores(int(ray.cluster_resources().get("CPU", 0)), cfg)
        yield ray
        return
    if cfg.address is None:
        _require_cores(_cores(cfg), cfg)
    if cfg.address is not None and cfg.address != "auto":
        _require_answer(cfg.address)
    try:
        with _own_signals():
            ray.init(**_settings(cfg))
    except (RuntimeError, ConnectionError, ValueError) as error:
        raise ActorsError(_reason(error, cfg.address)) from None
    try:
        _require_cores(int(ray.cluster_resources().get("CPU", 0)), cfg)
        yield ray
    finally:
        ray.shutdown()


def versions() -> dict[str, str]:
    """What must be the same on all machines, by name."""
    found = {name: importlib.metadata.version(name) for name in _PACKAGES}
    return {"Python": platform.python_version(), **found}


def require_same_versions(theirs: dict[str, str], node: str) -> None:
    """Go on only if a machine has the versions of this one.

    Raises:
        ActorsError: one differs.
    """
    ours = versions()
    for name, version in ours.items():
        if theirs.get(name) != version:
            raise ActorsError(
                f"{node} has {name} {theirs.get(name, 'not at all')}, this machine "
                f"{version}: install the same on both, as with constraints.txt"
            )


def _settings(cfg: ActorsCfg) -> dict[str, Any]:
    common = {"log_to_driver": False, "logging_level": "ERROR"}
    if cfg.address is not None:
        return {"address": cfg.address, **common}
    return {
        "num_cpus": _cores(cfg),
        "include_dashboard": False,
        "object_store_memory": _STORE_BYTES,
        **common,
    }


def _cores(cfg: ActorsCfg) -> int:
    """Cores of a Ray that is started here."""
    return cfg.cores or len(os.sched_getaffinity(0))


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
    """Ask before Ray does, which tries for minutes and then ends the process."""
    host, colon, port = address.rpartition(":")
    if not (colon and host and port.isdecimal() and int(port) < 2**16):
        raise ActorsError(
            f"--ray takes HOST:PORT, as `ray start --head` prints it, or `auto`; got "
            f"{address}"
        )
    try:
        socket.create_connection((host, int(port)), _CONNECT_S).close()
    except OSError as error:
        raise ActorsError(
            f"nothing answers at --ray {address} ({error.strerror or error}): start "
            "one with `ray start --head --port 6379` and give its HOST:PORT"
        ) from None
    # What listens there may be something else.
    script = Path(sys.executable).with_name("ray")
    asked = [str(script), "health-check", "--skip-version-check", "--address", address]
    try:
        healthy = not subprocess.run(
            asked, capture_output=True, timeout=_ANSWER_S, check=False
        ).returncode
    except subprocess.TimeoutExpired:
        healthy = False
    if not healthy:
        raise ActorsError(
            f"what answers at --ray {address} is not Ray, or is busy ending: give the "
            "HOST:PORT that `ray start --head` printed"
        )


def _reason(error: BaseException, address: str | None) -> str:
    """One line for what Ray says in many."""
    told = " ".join(str(error).split())
    if "ersion mismatch" in told:
        return (
            f"the Ray at {address} runs other versions than this machine ({told[:200]}"
            "): install the same Ray and Python on both"
        )
    if address is None:
        return f"Ray cannot be started here ({told[:200]}): is there memory left?"
    return (
        f"--ray {address} cannot be joined from this machine ({told[:200]}): start "
        "gaitpref on a machine of that cluster, after `ray start --address HOST:PORT`"
    )


def _require_cores(cores: int, cfg: ActorsCfg) -> None:
    if cfg.actors > cores:
        where = "this machine" if cfg.address is None else f"the Ray at {cfg.address}"
        raise ActorsError(
            f"--actors {cfg.actors} needs as many cores, {where} has {cores}: give "
            f"--actors {max(cores, 1)}, or --ray with the address of a larger one"
        )
