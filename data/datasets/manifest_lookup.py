"""Finds one episode in a manifest of any length without reading all of it."""

from __future__ import annotations

import json
import os
from pathlib import Path

from data.errors import DatasetError
from data.files.files import open_regular
from data.files.limits import MANIFEST_LINE_BYTES

from .manifest import EpisodeEntry, damaged, decode_line, line_hash, require_readable

_HEADER_BYTES = 4096
_BLOCK_BYTES = 4096
_END = b"\n]}\n"


def require_manifest(path: Path) -> None:
    """Look at the first line only: is it a manifest this version reads?

    Raises:
        DatasetError, FileError: it is not.
        OSError: it cannot be read.
    """
    with open_regular(path) as file:
        try:
            _first_line(file.fileno(), str(path))
        except DatasetError:
            raise
        except Exception as error:
            raise damaged(str(path), error) from error


def look_up(path: Path, sha256: str) -> EpisodeEntry | None:
    """The entry of an episode by bisection.

    None says that it was not found this way: an older manifest, or one that was edited,
    has to be read as a whole.

    Raises:
        DatasetError: the manifest or the line found is damaged, or of another version.
        OSError: it cannot be read.
    """
    with open_regular(path) as file:
        try:
            line = _bisect(file.fileno(), sha256, str(path))
            return None if line is None else decode_line(line, str(path))
        except DatasetError:
            raise
        except Exception as error:
            raise damaged(str(path), error) from error


def _bisect(descriptor: int, sha256: str, name: str) -> bytes | None:
    low = _first_line(descriptor, name)
    high = os.fstat(descriptor).st_size - len(_END)
    while low is not None and low < high:
        start, line = _line_around(descriptor, (low + high) // 2, low, high)
        found = line_hash(line)
        if found is None:
            return None
        if found == sha256:
            return line
        if found < sha256:
            low = start + len(line) + 1
        else:
            high = start - 1
    return None


def _first_line(descriptor: int, name: str) -> int | None:
    """Where the second line starts; None if the manifest is not in lines."""
    header, newline, _ = os.pread(descriptor, _HEADER_BYTES, 0).partition(b"\n")
    if not newline or not header.endswith(b'"files": ['):
        return None
    require_readable(json.loads(header + b"]}"), name)
    return len(header) + 1


def _line_around(
    descriptor: int, position: int, low: int, high: int
) -> tuple[int, bytes]:
    """Where the line that `position` lies in starts, and the line itself."""
    size = _BLOCK_BYTES
    while True:
        first, last = max(low, position - size), min(high, position + size)
        block = os.pread(descriptor, last - first, first)
        before = block.rfind(b"\n", 0, position - first)
        after = block.find(b"\n", position - first)
        if (before >= 0 or first == low) and (after >= 0 or last == high):
            start = before + 1
            return first + start, block[start : after if after >= 0 else None]
        if size > MANIFEST_LINE_BYTES:
            raise ValueError(f"a line has more than {MANIFEST_LINE_BYTES} bytes")
        size *= 4
