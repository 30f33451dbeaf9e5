"""Room for more numbers than memory should hold: in a file that goes by itself."""

from __future__ import annotations

import mmap
import os
import tempfile

import numpy as np

LARGE_BYTES = 2**27
"""What is larger goes to a file, if there is room: some 3,000 answers about clips of
1.2 s."""
_RELEASED_BYTES = 2**26
"""What is used of it before the system may have the memory back."""


class Spool:
    """A float32 array [...] of zeros in an unnamed file of the temporary directory."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        """Take the room.

        Raises:
            OSError: there is not so much.
        """
        size = 4 * int(np.prod(shape))
        with tempfile.TemporaryFile() as file:
            # Now, or a write to a full disk would end the process without a word.
            os.posix_fallocate(file.fileno(), 0, size)
            self._map = mmap.mmap(file.fileno(), size)
        self.array = np.frombuffer(self._map, dtype=np.float32).reshape(shape)
        self._used = 0

    def used(self, size: int) -> None:
        """So many bytes were read or written; the memory that holds them is not needed
        for long."""
        self._used += size
        if self._used >= _RELEASED_BYTES:
            self.release()

    def release(self) -> None:
        """Let the system have the memory back; what was written stays."""
        self._map.madvise(mmap.MADV_DONTNEED)
        self._used = 0


def zeros(shape: tuple[int, ...]) -> tuple[np.ndarray, Spool | None]:
    """A float32 array of zeros, and the spool it is in, where it is large and there is
    room for one."""
    if 4 * np.prod(shape) > LARGE_BYTES:
        try:
            spool = Spool(shape)
        except (OSError, AttributeError):
            # A full disk, or a system that cannot promise room on one.
            pass
        else:
            return spool.array, spool
    return np.zeros(shape, dtype=np.float32), None
