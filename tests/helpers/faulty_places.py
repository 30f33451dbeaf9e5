"""Runs every command where something is wrong with a file, a disk or an output.

`python -m tests.helpers.faulty_places WORLD FOUND` writes what became of each, a JSON
file for every place; `tests/cli/test_command_faults.py` judges it. A process of its
own, because it takes rights away from itself and mounts what only it can see.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import functools
import hashlib
import io
import json
import os
import resource
import shutil
import signal
import socket
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import gaitpref.cli.commands.label
import gaitpref.cli.commands.looking.play
import gaitpref.cli.commands.looking.watch
from gaitpref.cli.main import main
from tests.helpers.command_table import TABLE, Typed

LIMIT_S = 60
"""A command that takes longer hangs."""
LONG = ("loop", "sweep", "export", "explain", "train", "arena", "options")
"""What takes longest where nothing stops it."""
CANNOT = 77
"""The exit code where this machine does not allow the place."""
_LIBC = ctypes.CDLL(None, use_errno=True)
_NEW_NAMESPACE, _NEW_USER = 0x20000, 0x10000000
_READ_ONLY, _REMOUNT, _PRIVATE, _RECURSIVE, _LAZILY = 1, 32, 1 << 18, 16384, 2


@dataclass(frozen=True)
class Outcome:
    """What became of one command."""

    code: int
    out: str
    err: str
    unchanged: bool
    """Whether everything it read is as it was, and nothing half-made lies beside."""


class TooSlow(BaseException):
    """It was still running after `LIMIT_S`."""


def outcome(args: list[str], kept: Path) -> Outcome:
    """Run one command; `kept` is what it must not change."""
    before = _state(kept)
    out, err = io.StringIO(), io.StringIO()
    signal.signal(signal.SIGALRM, _too_slow)
    signal.alarm(LIMIT_S)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = main(args)
    except SystemExit as left:
        code = int(left.code or 0)
    except BaseException:
        code = 1
        err.write(traceback.format_exc())
    finally:
        signal.alarm(0)
    after = _state(kept)
    same = all(after.get(name) == content for name, content in before.items())
    half_made = any(name.endswith(".tmp") for name in after)
    return Outcome(code, out.getvalue(), err.getvalue(), same and not half_made)


def _too_slow(*_: object) -> None:
    raise TooSlow


def _state(root: Path) -> dict[str, str]:
    """Every file and what is in it, but for the notes SQLite makes for itself."""
    found = {}
    for folder, _, names in os.walk(root):
        for name in names:
            path = Path(folder, name)
            if path.is_file() and not name.endswith(("-wal", "-shm", ".lock")):
                found[str(path)] = _digest(path)
            elif not path.is_file():
                found[str(path)] = "no file"
    return found


def _digest(path: Path) -> str:
    told = path.stat()
    if told.st_size > 2**28:
        return f"{told.st_size} bytes"
    return _content(path, told.st_dev, told.st_ino, told.st_ctime_ns)


@functools.cache
def _content(path: Path, *_: int) -> str:
    """What is in a file, read once for as long as nobody touches it: the time of its
    last change cannot be set by who writes."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except PermissionError:
        return "not to be read"


# What can stand where a file is wanted.


def _fifo(path: Path) -> None:
    os.mkfifo(path)


def _socket(path: Path) -> None:
    """Through a short name: that of a socket has 107 letters at most."""
    with tempfile.TemporaryDirectory() as short, socket.socket(socket.AF_UNIX) as made:
        made.bind(f"{short}/s")
        Path(short, "s").rename(path)


def _loop(path: Path) -> None:
    path.symlink_to(path.name)


def _device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def _nothing(path: Path) -> None:
    """Leave the place empty."""


def _empty(path: Path) -> None:
    path.write_bytes(b"")


def _noise(path: Path) -> None:
    path.write_bytes(bytes(range(256)) * 8)


def _deep(path: Path) -> None:
    path.write_bytes(b"[" * 200_000)


def _huge(path: Path) -> None:
    """Ten gigabytes that take no room."""
    with path.open("wb") as file:
        file.truncate(10 * 2**30)


def _unreadable(path: Path) -> None:
    path.write_bytes(b"mine")
    path.chmod(0)


IN_PLACE: dict[str, Callable[[Path], None]] = {
    "fifo": _fifo,
    "directory": Path.mkdir,
    "socket": _socket,
    "device": _device,
    "link to itself": _loop,
    "nothing": _nothing,
    "empty file": _empty,
    "noise": _noise,
    "nested": _deep,
    "10 GB": _huge,
    "unreadable": _unreadable,
}


def inputs(world: Path) -> dict[str, Outcome]:
    """Every input of commands replaced by each of `IN_PLACE`, the commands by turns."""
    _without_override()
    found = {}
    users: dict[str, list[int]] = {}
    for number, typed in enumerate(TABLE):
        for part in typed.parts():
            if part == "go1.toml" and typed.line.startswith("loop"):
                # Hints that are missing are none, and a loop takes minutes.
                continue
            if part == "set/raters.json" and typed.words[0] not in ("raters", "label"):
                # Nothing else reads it.
                continue
            users.setdefault(part, []).append(number)
    for part, numbers in users.items():
        turns = max(len(numbers), len(IN_PLACE))
        for turn in range(turns):
            number = numbers[turn % len(numbers)]
            kind = list(IN_PLACE)[turn % len(IN_PLACE)]
            with _replaced(world / part, IN_PLACE[kind]):
                found[f"{number}|{part}|{kind}"] = _once(TABLE[number], world)
    return found


def _once(typed: Typed, world: Path) -> Outcome:
    """One command on a world that may change, but not by a failure."""
    out = world.parent / "made" / "out"
    out.parent.mkdir(exist_ok=True)
    try:
        return outcome(typed.args(world, out), world if not typed.writes_set else out)
    finally:
        shutil.rmtree(out.parent, ignore_errors=True)


@contextlib.contextmanager
def _replaced(path: Path, make: Callable[[Path], None]) -> Iterator[None]:
    aside = path.with_name("aside")
    there = path.exists()
    if there:
        path.rename(aside)
    make(path)
    try:
        yield
    finally:
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
        if there:
            aside.rename(path)


# Where something is to be written.


def outputs(world: Path) -> dict[str, Outcome]:
    """Every command with something else where its output should go."""
    _without_override()
    found = {}
    for number, typed in enumerate(TABLE):
        if not typed.writes_out:
            continue
        for kind in ("fifo", "under a file"):
            with tempfile.TemporaryDirectory(dir=world.parent) as folder:
                out = Path(folder, "out")
                if kind == "fifo":
                    os.mkfifo(out)
                else:
                    out.write_text("mine")
                    out = out / "deeper"
                found[f"{number}|{kind}"] = outcome(typed.args(world, out), world)
    return found


def denied(world: Path) -> dict[str, Outcome]:
    """Every command where nobody may write: neither there nor into the data set."""
    _without_override()
    folder = world.parent / "denied"
    folder.mkdir()
    for path in (folder, *(Path(d) for d, _, _ in os.walk(world))):
        path.chmod(0o555)
    for path in world.rglob("*"):
        if path.is_file():
            path.chmod(0o444)
    return {
        str(number): outcome(typed.args(world, folder / "out"), world)
        for number, typed in enumerate(TABLE)
    }


def read_only(world: Path) -> dict[str, Outcome]:
    """Every command on a disk that is read-only, its output too."""
    with _mounted(world):
        _call("mount", None, os.fsencode(world), None, _REMOUNT | _READ_ONLY, None)
        return {
            str(number): outcome(typed.args(world, world / "out"), world)
            for number, typed in enumerate(TABLE)
        }


def read_only_source(world: Path) -> dict[str, Outcome]:
    """The same with the output elsewhere: who only reads comes to an end."""
    outs = [Path(tempfile.mkdtemp(dir=world.parent), "out") for _ in TABLE]
    with _mounted(world):
        _call("mount", None, os.fsencode(world), None, _REMOUNT | _READ_ONLY, None)
        return {
            str(number): outcome(typed.args(world, outs[number]), world)
            for number, typed in enumerate(TABLE)
            if not typed.line.startswith(LONG)
        }


def full(world: Path) -> dict[str, Outcome]:
    """Every command on a disk without a free byte."""
    with _mounted(world):
        with contextlib.suppress(OSError), (world / "ballast").open("wb", 0) as file:
            while True:
                file.write(bytes(2**12))
        return {
            str(number): outcome(typed.args(world, world / f"out{number}"), world)
            for number, typed in enumerate(TABLE)
        }


def small_files(world: Path) -> dict[str, Outcome]:
    """Every command where files have 200 bytes at most: writing is cut short."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (200, resource.RLIM_INFINITY))
    found = {}
    for number, typed in enumerate(TABLE):
        if typed.line.startswith(LONG):
            continue
        out = world.parent / "small" / str(number)
        out.parent.mkdir(exist_ok=True)
        found[str(number)] = outcome(typed.args(world, out), world)
    resource.setrlimit(resource.RLIMIT_FSIZE, (-1, -1))
    return found


@contextlib.contextmanager
def _mounted(world: Path) -> Iterator[None]:
    """Move the world onto a file system in memory that only this process sees."""
    copy = world.with_name("copy")
    shutil.copytree(world, copy)
    try:
        _call("unshare", _NEW_NAMESPACE)
    except PermissionError:
        user, group = os.getuid(), os.getgid()
        _call("unshare", _NEW_NAMESPACE | _NEW_USER)
        Path("/proc/self/setgroups").write_text("deny")
        Path("/proc/self/uid_map").write_text(f"0 {user} 1")
        Path("/proc/self/gid_map").write_text(f"0 {group} 1")
    _call("mount", None, b"/", None, _PRIVATE | _RECURSIVE, None)
    _call("mount", b"tmpfs", os.fsencode(world), b"tmpfs", 0, b"size=16m")
    try:
        shutil.copytree(copy, world, dirs_exist_ok=True)
        yield
    finally:
        _call("umount2", os.fsencode(world), _LAZILY)


def _call(name: str, *values: object) -> None:
    if getattr(_LIBC, name)(*values) != 0:
        number = ctypes.get_errno()
        raise PermissionError(number, os.strerror(number), name)


def _without_override() -> None:
    """Let rights of files count for root as well."""
    if os.geteuid() != 0:
        return

    class Head(ctypes.Structure):
        _fields_ = (("version", ctypes.c_uint32), ("pid", ctypes.c_int))

    head, sets = Head(0x20080522, 0), (ctypes.c_uint32 * 6)()
    _call("capget", ctypes.byref(head), sets)
    # The rights to write and to read whatever the rights of a file say.
    sets[0] &= ~0b110
    _call("capset", ctypes.byref(head), sets)


PLACES: dict[str, Callable[[Path], dict[str, Outcome]]] = {
    "inputs": inputs,
    "outputs": outputs,
    "denied": denied,
    "read-only": read_only,
    "read-only source": read_only_source,
    "full": full,
    "small files": small_files,
}


def run(world: Path, place: str, found: Path) -> int:
    """Write what became of every command in one place; gives the exit code."""
    for module in (
        gaitpref.cli.commands.label,
        gaitpref.cli.commands.looking.play,
        gaitpref.cli.commands.looking.watch,
    ):
        module.wait_until_stopped = lambda _: None  # type: ignore[attr-defined]
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o755)
        os.chdir(folder)
        own = Path(folder, "world")
        shutil.copytree(world, own)
        try:
            outcomes = PLACES[place](own)
        except PermissionError as error:
            if error.errno not in (errno.EPERM, errno.EINVAL, errno.EACCES):
                raise
            return CANNOT
        told = {name: asdict(result) for name, result in outcomes.items()}
        found.write_text(json.dumps(told))
    return 0


def main_of_places(world: Path, found: Path) -> int:
    """Run every place in a process of its own, which is made of this one."""
    code = 0
    for place in PLACES:
        child = os.fork()
        if child == 0:
            try:
                os._exit(run(world, place, found / f"{place}.json"))
            except BaseException:
                traceback.print_exc()
                os._exit(1)
        ended = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        if ended == CANNOT:
            (found / f"{place}.json").write_text("null")
        elif ended:
            print(f"{place} ended with {ended}", file=sys.stderr)
            code = 1
    return code


if __name__ == "__main__":
    sys.exit(main_of_places(Path(sys.argv[1]), Path(sys.argv[2])))
