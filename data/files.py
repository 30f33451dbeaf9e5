"""Files that are either whole or not there, and their hashes."""

from __future__ import annotations

import fcntl
import hashlib
import os
import secrets
import shutil
from pathlib import Path


def sha256_bytes(content: bytes) -> str:
    """SHA-256 as lower-case hex."""
    return hashlib.sha256(content).hexdigest()


def sha256_file(path: Path) -> str:
    """SHA-256 of a file's bytes as lower-case hex.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
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
        OSError: the directory is missing, or the disk is full.
    """
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
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    if sync_name:
        fsync_directory(path.parent)


def replace_directory(partial: Path, final: Path) -> None:
    """Give a finished directory its final name, so that the name means "finished".

    Everything in `partial` is on the disk before it is renamed. A `final` that exists
    is removed; a crash in between leaves no `final`, never a mixture.

    Raises:
        OSError: `partial` is missing, or both are not on one file system.
    """
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
