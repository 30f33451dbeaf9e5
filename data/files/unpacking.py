"""Unpacks what others compressed to no more than was said beforehand."""

from __future__ import annotations

import zipfile
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import zstandard

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
"""How a frame of zstd begins."""
_LARGEST_WINDOW = 2**27
"""What zstd itself takes unless told otherwise; the strongest level that is usual."""
_PIECE = 2**20


def unpack_zstd(content: bytes | memoryview, size: int, limit: int) -> bytes:
    """The `size` bytes that a frame holds, whatever the frame says of itself.

    Raises:
        ValueError: they are more than `limit`, or the frame holds more or fewer.
    """
    require_size(size, limit)
    try:
        unpacker = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW)
        # Asked in one go, zstandard believes the frame and not its caller.
        with unpacker.stream_reader(content) as reader:
            found = reader.read(size) if size else b""
            more = bool(reader.read(1))
    except zstandard.ZstdError as error:
        raise ValueError(f"it does not unpack: {error}") from error
    if more or len(found) != size:
        than = "more" if more else f"{len(found)}"
        raise ValueError(f"it claims to unpack to {size} bytes and gives {than}")
    return found


def unpack_zstd_frame(content: bytes, limit: int) -> bytes:
    """What a frame holds, where nobody said beforehand how much that is.

    Raises:
        ValueError: it is more than `limit`, or no whole frame.
    """
    try:
        unpacker = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW)
        with unpacker.stream_reader(content) as reader:
            found = reader.read(limit + 1)
    except zstandard.ZstdError as error:
        raise ValueError(f"it does not unpack: {error}") from error
    require_size(len(found), limit)
    return found


def unpack_zstd_to(file: BinaryIO, place: Path, limit: int) -> None:
    """Unpack frames of zstd in an open file to a new file, piece by piece.

    Raises:
        ValueError: it is more than `limit`, or breaks off.
        OSError: the disk is full.
    """
    size = 0
    unpacker = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW)
    try:
        with (
            unpacker.stream_reader(file, read_across_frames=True) as reader,
            place.open("xb") as out,
        ):
            while piece := reader.read(_PIECE):
                size += len(piece)
                require_size(size, limit)
                out.write(piece)
    except zstandard.ZstdError as error:
        raise ValueError(f"it does not unpack: {error}") from error


def unpack_lz4(content: bytes | memoryview, size: int, limit: int) -> bytes:
    """What a frame of lz4 holds, if it is no more than was said beforehand."""
    # It comes with mcap, and only bags of others are packed with it.
    from lz4.frame import LZ4FrameDecompressor

    require_size(size, limit)
    unpacker = LZ4FrameDecompressor()
    try:
        found = unpacker.decompress(content, max_length=size + 1)
    except (RuntimeError, EOFError) as error:
        raise ValueError(f"it does not unpack: {error}") from error
    if len(found) != size:
        than = "more" if len(found) > size else f"{len(found)}"
        raise ValueError(f"it claims to unpack to {size} bytes and gives {than}")
    return found


def require_size(size: int, limit: int) -> None:
    """Refuse what claims too much, before anything is unpacked.

    Raises:
        ValueError: it does.
    """
    if size > limit:
        raise ValueError(f"it claims to unpack to {size} bytes, the limit is {limit}")


def require_stored(archive: bytes) -> None:
    """Make sure that a zip holds no more than its own size, as all of ours do.

    Raises:
        ValueError: it is no zip, or something in it is compressed or there twice.
    """
    try:
        with zipfile.ZipFile(BytesIO(archive)) as file:
            members = file.infolist()
    except (zipfile.BadZipFile, NotImplementedError, EOFError) as error:
        raise ValueError(str(error)) from error
    for member in members:
        if member.compress_type != zipfile.ZIP_STORED:
            raise ValueError(f"{member.filename[:80]} in it is compressed")
    require_size(sum(member.file_size for member in members), len(archive))
