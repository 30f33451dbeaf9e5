"""What an operating system's error means to whoever runs a command."""

from __future__ import annotations

import errno
import re

_AGAIN = "nothing that was there is lost; make room and run the same command again"
_ELSEWHERE = "nothing that was there is lost; give a place that can be written"
_RIGHTS = "ask for the rights, or give another path"

_PASSING = re.compile(r"\.([^/]+)\.[0-9a-f]{16}\.(?:tmp|old)(?=/|$)")
"""A name that a file or a directory has until it is whole."""
_LASTING = r"\1"

_REASONS: dict[int, tuple[str, str]] = {
    errno.ENOSPC: ("the disk is full", _AGAIN),
    errno.EDQUOT: ("your share of the disk is used up", _AGAIN),
    errno.EFBIG: (
        "a file may not become that large",
        "nothing that was there is lost; raise the limit (`ulimit -f`) or use another "
        "file system, and run the same command again",
    ),
    errno.EROFS: ("it is read-only", _ELSEWHERE),
    errno.EACCES: ("you may not read or write there", _RIGHTS),
    errno.EPERM: ("you may not read or write there", _RIGHTS),
    errno.EISDIR: ("it is a directory, where a file is wanted", "give another path"),
    errno.ENOTDIR: (
        "a part of the path is a file, where a directory is wanted",
        "give another path",
    ),
    errno.ENOTEMPTY: ("it is a directory with something in it", "give another path"),
    errno.EEXIST: ("something else is there already", "give another path"),
    errno.ENOENT: ("it is missing", "check the path"),
    errno.ELOOP: ("its links lead in a circle", "give the path of the file itself"),
    errno.ENAMETOOLONG: ("the name is too long", "give a shorter path"),
    errno.ENXIO: ("it is no file", "give the path of a file"),
    errno.EMFILE: (
        "too many files are open",
        "raise the limit (`ulimit -n`) and run the same command again",
    ),
    errno.ENFILE: (
        "too many files are open on this machine",
        "close other programs and run the same command again",
    ),
    errno.EIO: (
        "the disk failed",
        "check it, copy what is on it elsewhere, and run the same command there",
    ),
    errno.ENOLCK: ("its file system has no locks", "use another file system"),
    errno.EBUSY: ("something else uses it", "close that and run the command again"),
    errno.ETXTBSY: ("something else uses it", "close that and run the command again"),
    errno.ESTALE: ("its file server lost it", "mount it again"),
    errno.EXDEV: ("it lies on another file system", "give a place on the same one"),
    errno.EBADF: ("it is closed", "open it, or send it to a file"),
}

_NOT_WRITABLE = {
    errno.EACCES,
    errno.EPERM,
    errno.EROFS,
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EFBIG,
}


def cause(error: OSError) -> str | None:
    """Why something cannot be written; None where the error is of another kind."""
    if error.errno not in _NOT_WRITABLE:
        return None
    return f"{_REASONS[error.errno][0]} ({error.strerror})"


def told(error: OSError) -> str | None:
    """One line that says what happened to which file, and what to do.

    None where nobody but the author of the code can do something.
    """
    if error.errno not in _REASONS:
        return None
    reason, advice = _REASONS[error.errno]
    # Of a rename the second is what it was about.
    name = error.filename if error.filename2 is None else error.filename2
    where = "" if name is None else f"{_PASSING.sub(_LASTING, str(name))}: "
    return f"{where}{reason} ({error.strerror}); {advice}"


def is_full(error: OSError) -> bool:
    """Whether the same command ends well once there is room."""
    return error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
