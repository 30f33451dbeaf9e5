"""What the machine can do: draw, open a browser, train on a GPU, keep files."""

from __future__ import annotations

import errno
import os
import shutil
import socket
import tempfile
from pathlib import Path

from gaitpref.console.browser import has_browser

from .finding import Finding

_GIB = 2**30
_LEAST_FREE_GIB, _LEAST_MEMORY_GIB = 1.0, 2.0
PORT = 8080
"""Where the pages are served unless somebody says otherwise."""
_NVIDIA = ("/dev/nvidiactl", "/dev/dxg", "/proc/driver/nvidia/version")
"""One of them is there where the system has a driver."""


def renderer() -> Finding:
    """Whether MuJoCo draws pictures without a display."""
    name = "pictures of the robot"
    try:
        import mujoco

        from gaitpref.film.camera import Camera, NoRenderer
    except ModuleNotFoundError as error:
        return Finding(
            name=name,
            state="missing",
            told=f"{error.name} is not installed",
            advice="pip install -e '.[label]' -c constraints.txt",
        )
    try:
        Camera(mujoco.MjModel.from_xml_string("<mujoco/>")).close()
    except NoRenderer as why:
        told, _, advice = str(why).rpartition("; ")
        return Finding(name=name, state="missing", told=told, advice=advice)
    kind = os.environ.get("MUJOCO_GL", "")
    return Finding(
        name=name,
        state="ok",
        told="MuJoCo draws without a display"
        + (f" (MUJOCO_GL={kind})" if kind else ""),
    )


def browser() -> Finding:
    """Whether `--open` can open one."""
    found = has_browser()
    return Finding(
        name="browser",
        state="ok" if found else "missing",
        told="--open opens it" if found else "none is found on this machine",
        advice=""
        if found
        else "open the address a command prints on another machine, through `ssh -L "
        f"{PORT}:127.0.0.1:{PORT} HOST`",
    )


def gpu() -> Finding:
    """Whether policies can be trained on an NVIDIA GPU."""
    name = "NVIDIA GPU"
    if not any(map(os.path.exists, _NVIDIA)):
        return Finding(name=name, state="ok", told="none; two cores are enough")
    try:
        import torch
    except ModuleNotFoundError:
        return Finding(
            name=name,
            state="missing",
            told="there is one, and torch is not installed",
            advice="pip install -e '.[gpu]' -c constraints.txt",
        )
    if not torch.cuda.is_available():
        built = torch.version.cuda
        return Finding(
            name=name,
            state="bad",
            told=f"there is a driver, and torch {torch.__version__} sees no GPU",
            advice="look whether `nvidia-smi` sees one, and whether its driver is new "
            f"enough for CUDA {built}"
            if built
            else "install a torch that is built for CUDA: this one is not",
        )
    told = torch.cuda.get_device_name(0)
    try:
        import mujoco_warp  # noqa: F401
        import warp  # noqa: F401
    except ModuleNotFoundError as error:
        return Finding(
            name=name,
            state="missing",
            told=f"{told}; {error.name} is not installed",
            advice="pip install -e '.[gpu]' -c constraints.txt",
        )
    return Finding(name=name, state="ok", told=f"{told}: --device cuda trains on it")


def place() -> Finding:
    """Whether files can be written where commands write them, and how many."""
    here = Path.cwd()
    name = "this directory"
    try:
        with tempfile.TemporaryFile(dir=here):
            free_gib = shutil.disk_usage(here).free / _GIB
    except OSError as error:
        return Finding(
            name=name,
            state="bad",
            told=f"{here} cannot be written ({error.strerror})",
            advice="go to a directory of yours",
            needed=True,
        )
    enough = free_gib >= _LEAST_FREE_GIB
    return Finding(
        name=name,
        state="ok" if enough else "bad",
        told=f"{here}, {free_gib:.1f} GiB free",
        advice=""
        if enough
        else f"make room: a run takes some 100 MiB, {_LEAST_FREE_GIB:g} GiB is enough",
    )


def processor() -> Finding:
    """Cores and memory."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
    memory_gib = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / _GIB
    told = f"{cores} cores, {memory_gib:.1f} GiB"
    if memory_gib < _LEAST_MEMORY_GIB:
        advice = (
            f"train elsewhere: it takes {_LEAST_MEMORY_GIB:g} GiB; label and fit here"
        )
        return Finding(name="processor, memory", state="bad", told=told, advice=advice)
    return Finding(name="processor, memory", state="ok", told=told)


def port(number: int = PORT) -> Finding:
    """Whether the pages can be served where they are by default."""
    try:
        _open(number)
    except OSError as error:
        busy = error.errno == errno.EADDRINUSE
        return Finding(
            name="port of the pages",
            state="bad",
            told=f"{number} is taken" if busy else f"{number}: {error.strerror}",
            advice=f"give the commands --port {_open(0)}, or stop what has it",
        )
    return Finding(name="port of the pages", state="ok", told=f"{number} is free")


def _open(number: int) -> int:
    """The port, opened and closed again."""
    with socket.socket() as probe:
        # As the pages do: one that was closed a moment ago is free.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind(("127.0.0.1", number))
        return probe.getsockname()[1]
