"""Files that are either whole or not there, their hashes, and the door they come in by.

Whatever is read comes through `open_regular`: a pipe, which would be waited for without
an end, a device or a directory in the place of a file is told in one line.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import json
import os
import secrets
import shutil
import stat
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path
from typing import Any, BinaryIO

from data.errors import FileError

from .limits import FACTS_BYTES

_KINDS: tuple[tuple[Callable[[int], bool], str], ...] = (
    (stat.S_ISDIR, "a directory"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def open_regular(path: Path) -> BufferedReader:
    """Open a file to read its bytes, and nothing but a file.

    Raises:
        FileError: it is something else, as a directory or a pipe.
        OSError: it is missing, or cannot be read.
    """
    try:
        # A pipe that nobody writes to would be waited for here.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        if error.errno in (errno.ENXIO, errno.ENODEV, errno.EOPNOTSUPP):
            require_regular(path)
        raise
    try:
        require_file_mode(path, os.fstat(descriptor).st_mode)
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


class BoundedFile:
    """An open file whose bytes come in pieces of `most` bytes, and no larger ones.

    For libraries that read as much as a file says they should.
    """

    def __init__(self, file: BinaryIO, most: int) -> None:
        self._file, self._most = file, most

    def read(self, size: int = -1) -> bytes:
        """The next bytes, all of them by default.

        Raises:
            ValueError: they are too many.
        """
        too_many = self._most + 1
        content = self._file.read(too_many if size < 0 else min(size, too_many))
        if len(content) == too_many:
            raise ValueError(f"a part of it has more than {self._most:,} bytes")
        return content

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


def read_file(path: Path, limit: int) -> bytes:
    """The bytes of a file of `limit` bytes at most.

    Raises:
        FileError: it is no file, or longer; the message says how long.
        OSError: it is missing, or cannot be read.
    """
    with open_regular(path) as file:
        return read_bounded(file, path, limit)


def read_bounded(file: BinaryIO, path: Path, limit: int) -> bytes:
    """What is left of an open file, `path`, of `limit` bytes at most.

    Raises:
        FileError, OSError: as for `read_file`.
    """
    size = os.fstat(file.fileno()).st_size
    content = file.read(limit + 1) if size <= limit else b""
    if size > limit or len(content) > limit:
        raise _too_long(path, max(size, len(content)), limit)
    return content


def read_text(path: Path, limit: int) -> str:
    """The UTF-8 text of a file of `limit` bytes at most.

    Raises:
        FileError, OSError: as for `read_file`.
        UnicodeDecodeError: it is no such text.
    """
    return read_file(path, limit).decode()


def read_json(path: Path, limit: int = FACTS_BYTES) -> Any:
    """What a file of JSON says.

    Raises:
        FileError: as for `read_file`, or it holds no JSON.
        OSError: it is missing, or cannot be read.
    """
    content = read_file(path, limit)
    try:
        return json.loads(content)
    except (ValueError, RecursionError) as error:
        raise FileError(
            f"{path} is damaged, it holds no JSON ({error}); restore it from a copy"
        ) from error


def require_regular(path: Path, limit: int | None = None) -> None:
    """Make sure that a path leads to a file that others may open.

    It is not opened here: SQLite drops its locks when anybody in the process closes the
    file.

    Raises:
        FileError: it is something else, or longer than `limit` bytes.
        OSError: it is missing.
    """
    found = os.stat(path)
    require_file_mode(path, found.st_mode)
    if limit is not None and found.st_size > limit:
        raise _too_long(path, found.st_size, limit)


def require_replaceable(path: Path) -> None:
    """Make sure that a file may be put where `path` is: nothing is there, or a file.

    A rename would put it in the place of a device as well.

    Raises:
        FileError: something else is there.
        OSError: its directory is no directory, or cannot be looked into.
    """
    try:
        require_regular(path)
    except FileNotFoundError:
        return


def require_file_mode(path: Path, mode: int) -> None:
    """Make sure that what was opened as `path` is a file, by its mode.

    Raises:
        FileError: it is something else.
    """
    if stat.S_ISREG(mode):
        return
    kinds = (name for is_kind, name in _KINDS if is_kind(mode))
    kind = next(kinds, "no file")
    raise FileError(f"{path} is {kind}, where a file is wanted; give another path")


def _too_long(path: Path, size: int, limit: int) -> FileError:
    return FileError(
        f"{path} has {size:,} bytes, such a file is read up to {limit:,}; give another "
        "file"
    )


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the lock file `path`, made if it is missing, against all others.

    Raises:
        FileError: it is no file.
        OSError: it cannot be made.
    """
    flags = os.O_RDWR | os.O_CREAT | os.O_NONBLOCK | os.O_CLOEXEC
    descriptor = os.open(path, flags, 0o666)
    try:
        require_file_mode(path, os.fstat(descriptor).st_mode)
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def sha256_bytes(content: bytes) -> str:
    """SHA-256 as lower-case hex."""
    return hashlib.sha256(content).hexdigest()


def sha256_file(path: Path) -> str:
    """SHA-256 of a file's bytes as lower-case hex.

    Raises:
        FileError, OSError: the file cannot be read.
    """
    with open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def fsync_directory(path: Path) -> None:
    """Make the names in a directory survive a power loss."""
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_atomically(
    path: Path, content: bytes, *, mode: int = 0o666, sync_name: bool = True
) -> None:
    """Write a file so that a reader, or a crash, sees all of it or what was before.

    Args:
        path: Where it shall be.
        content: What shall be in it.
        mode: Permissions of the file, less those the process never gives.
        sync_name: Wait until its name is on the disk too. Who writes many files into a
            directory calls `fsync_directory` once instead.

    Raises:
        FileError: something else than a file is there.
        OSError: the directory is missing, or the disk is full.
    """
    require_replaceable(path)
    # In the same directory, because a rename is only atomic within a file system.
    temporary = path.with_name(f".{path.name[:64]}.{secrets.token_hex(8)}.tmp")
    try:
        # The builtin, because `Path.open` cannot be told the permissions.
        with open(temporary, "xb", opener=lambda *a: os.open(*a, mode=mode)) as file:
            # Tells a recovery that the file still has a writer.
            fcntl.flock(file, fcntl.LOCK_SH)
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        if isinstance(error, OSError):
            # A full disk does not say where it is full, nor does anybody know a name
            # that was only meant for a moment.
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise
    if sync_name:
        fsync_directory(path.parent)


def require_directory(path: Path, names: Collection[str] | None = None) -> None:
    """Make sure that a directory may be put where `path` is.

    Args:
        path: Where it shall be.
        names: What a directory there may hold, which is replaced as a whole; by default
            anything.

    Raises:
        FileError: something else is there, or in it.
    """
    if path.is_symlink() or (path.exists() and not path.is_dir()):
        raise FileError(f"{path} is there already, and no directory; give another path")
    if names is not None and path.is_dir():
        others = sorted(p.name for p in path.iterdir() if p.name not in names)
        if others:
            # Of what is hidden nobody knows; it sorts first.
            raise FileError(
                f"{path} holds {others[-1]} and would be replaced as a whole; give a "
                f"directory that is new, or that holds {', '.join(names)} alone"
            )


@contextmanager
def whole_directory(final: Path, names: Collection[str]) -> Iterator[Path]:
    """A directory to be filled, which gets its name when the block ends, and is gone if
    it fails.

    Args:
        final: Where it shall be.
        names: What it holds, so that nothing else is replaced by it.

    Raises:
        FileError: something else is there, or in the directory there.
    """
    require_directory(final, names)
    final = final.resolve()
    partial = final.with_name(f".{final.name}.{secrets.token_hex(8)}.tmp")
    partial.mkdir(parents=True)
    try:
        yield partial
        replace_directory(partial, final)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def require_room(path: Path, size: int) -> None:
    """Make sure that a file of `size` bytes can be written to `path`.

    For libraries that do not bear a full disk: HDF5 ends the whole program.

    Raises:
        OSError: the disk has no room for it, or it cannot be made.
    """
    try:
        with path.open("xb") as file:
            os.posix_fallocate(file.fileno(), 0, size)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        path.unlink(missing_ok=True)


def replace_directory(partial: Path, final: Path) -> None:
    """Give a finished directory its final name, so that the name means "finished".

    Everything in `partial` is on the disk before it is renamed. A `final` that exists
    is removed; a crash in between leaves no `final`, never a mixture.

    Raises:
        FileError: `final` is there and no directory.
        OSError: `partial` is missing, or both are not on one file system.
    """
    require_directory(final)
    for directory, _, names in os.walk(partial):
        for name in names:
            with Path(directory, name).open("rb") as file:
                os.fsync(file.fileno())
        fsync_directory(Path(directory))
    if final.exists():
        # A directory cannot be exchanged for another in one portable step.
        aside = final.with_name(f".{final.name}.{secrets.token_hex(8)}.old")
        final.rename(aside)
        partial.rename(final)
        shutil.rmtree(aside)
    else:
        partial.rename(final)
    fsync_directory(final.parent)
