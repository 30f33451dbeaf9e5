"""One writer a directory: a second one is told who the first is, and ends."""

from __future__ import annotations

import errno
import fcntl
import os
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from data.errors import GaitprefError

from .files import require_file_mode

LOCK_NAME = ".lock"
_NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL}
_LONGEST_HOLDER = 200


class Busy(GaitprefError):
    """Another process writes there."""


@contextmanager
def only_writer(
    directory: Path, tell: Callable[[str], None], *, replaced: bool = False
) -> Iterator[None]:
    """Be the only process that writes into `directory`.

    The kernel drops the lock of a process that dies, however it does. The file of the
    lock is removed afterwards.

    Args:
        directory: What is written; made if it is missing, and gone again if nothing
            was written into it.
        tell: Gets a sentence where the file system has no locks.
        replaced: Whether the directory is replaced as a whole: the file of the lock
            is then beside it, not inside.

    Raises:
        Busy: another process is at it; the message says which.
        FileError: something else than a file is where the lock should be.
        OSError: the file cannot be made.
    """
    lock = directory / LOCK_NAME
    if replaced:
        out = directory.resolve()
        lock = out.with_name(f".{out.name}{LOCK_NAME}")
    missing = [path for path in lock.parents if not path.exists()]
    descriptor = _locked(directory, lock, tell)
    try:
        os.ftruncate(descriptor, 0)
        os.pwrite(
            descriptor, f"pid {os.getpid()} on {socket.gethostname()}".encode(), 0
        )
        yield
    finally:
        # While it is still locked: whoever opens it meanwhile sees that it is gone.
        lock.unlink(missing_ok=True)
        os.close(descriptor)
        with suppress(OSError):
            for path in missing:
                path.rmdir()


def _locked(directory: Path, lock: Path, tell: Callable[[str], None]) -> int:
    """A descriptor of the locked file."""
    while True:
        flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK
        try:
            lock.parent.mkdir(parents=True, exist_ok=True)
            descriptor = os.open(lock, flags, 0o666)
        except FileNotFoundError:
            # The writer before removed the directory, which it had made, meanwhile.
            continue
        except FileExistsError as error:
            # As above, between a look at the directory and the next.
            if os.path.isdir(error.filename) or not os.path.lexists(error.filename):
                continue
            raise
        try:
            require_file_mode(lock, os.fstat(descriptor).st_mode)
        except BaseException:
            os.close(descriptor)
            raise
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.pread(descriptor, _LONGEST_HOLDER, 0).decode(errors="replace")
            os.close(descriptor)
            raise Busy(
                f"{directory} is being written by another gaitpref "
                f"({holder or 'which has only just begun'}): wait for it or stop it, "
                "or give another directory"
            ) from None
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                os.close(descriptor)
                raise
            tell(
                f"the file system of {directory} has no locks ({error.strerror}): "
                "nothing keeps a second command from writing there at the same time"
            )
            return descriptor
        if _is_there(lock, descriptor):
            return descriptor
        # The writer before removed it after it was opened here.
        os.close(descriptor)


def _is_there(lock: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(os.stat(lock), os.fstat(descriptor))
    except FileNotFoundError:
        return False
