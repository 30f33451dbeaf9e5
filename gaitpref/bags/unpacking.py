"""No chunk of a bag unpacks to more than it claims, and than we allow.

The library takes a compressed frame at its word, and it can stand for any number of
bytes.
"""

from __future__ import annotations

import zlib
from io import BytesIO

from mcap import stream_reader
from mcap.data_stream import ReadDataStream
from mcap.records import Chunk

from data.limits import BAG_CHUNK_BYTES
from data.unpacking import require_size, unpack_zstd
from gaitpref.extras import require


def bound_chunks() -> None:
    """Let every reader of the library unpack chunks within our limits."""
    stream_reader.get_chunk_data_stream = _bounded


def _bounded(chunk: Chunk, validate_crc: bool = False) -> tuple[ReadDataStream, int]:
    content = _content(chunk)
    crc = chunk.uncompressed_crc
    if validate_crc and crc and zlib.crc32(content) != crc:
        raise ValueError("the checksum of a chunk is wrong")
    return ReadDataStream(BytesIO(content)), len(content)


def _content(chunk: Chunk) -> bytes:
    size = chunk.uncompressed_size
    if chunk.compression == "zstd":
        return unpack_zstd(chunk.data, size, BAG_CHUNK_BYTES)
    if chunk.compression == "lz4":
        require_size(size, BAG_CHUNK_BYTES)
        unpacker = require("lz4.frame", "view").LZ4FrameDecompressor()
        content = unpacker.decompress(chunk.data, max_length=size)
        if not unpacker.eof or len(content) != size:
            raise ValueError(f"a chunk claims {size} bytes and holds another number")
        return content
    if chunk.compression:
        raise ValueError(f"a chunk is compressed with {chunk.compression[:20]!r}")
    return chunk.data
