"""Finds records in the bytes of an MCAP file and compares its checksums.

What is wrong with a file is a ValueError here, except for what a user can tell apart;
the reader of episodes adds the file's name to it.
"""

from __future__ import annotations

import struct
import zlib
from io import BytesIO
from typing import TypeVar

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, McapRecord
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from data.errors import CorruptEpisode, TruncatedEpisode, UnsupportedSchema
from data.files.limits import EPISODE_CHUNK_BYTES
from data.files.unpacking import unpack_zstd

from . import schema

_FOOTER_BYTES = 29
_DATA_END_BYTES = 13
_DATA_END_HEAD = struct.pack("<BQ", Opcode.DATA_END, 4)

RecordT = TypeVar("RecordT", bound=McapRecord)


def summary_start(end: bytes, size: int, name: str) -> int:
    """Where the summary of a file begins.

    Args:
        end: The last bytes of the file, 37 at least, or all of them.
        size: Bytes of the whole file.
        name: What errors call it.

    Raises:
        TruncatedEpisode: it has no end.
        UnsupportedSchema: it has no summary.
        ValueError: its footer is damaged.
    """
    footer_start = size - _FOOTER_BYTES - len(MCAP0_MAGIC)
    if not end.endswith(MCAP0_MAGIC) or footer_start < 8 + _DATA_END_BYTES:
        raise TruncatedEpisode(
            f"{name} stops after {size} bytes without the end of an MCAP file; "
            "copy it again, or save what is whole with `gaitpref data recover`"
        )
    footer = end[-_FOOTER_BYTES - len(MCAP0_MAGIC) :]
    opcode, length, start = struct.unpack_from("<BQQ", footer)
    if start == 0:
        raise UnsupportedSchema(
            f"{name} has no summary, so another program wrote it; "
            "use the file that `gaitpref record` wrote"
        )
    if (opcode, length) != (Opcode.FOOTER, _FOOTER_BYTES - 9):
        raise ValueError("the footer is not where it should be")
    if not 8 + _DATA_END_BYTES <= start <= footer_start:
        raise ValueError(f"the summary cannot start at byte {start}")
    return start


def tail_start(end: bytes, size: int, name: str) -> int:
    """Where the tail begins: the checksum of all data, the summary and the footer.

    Args, Raises: as for `summary_start`.
    """
    return summary_start(end, size, name) - _DATA_END_BYTES


def require_magic(content: bytes, name: str) -> None:
    """Tell an MCAP file from something else.

    Raises:
        CorruptEpisode: it is no MCAP file.
    """
    if content[: len(MCAP0_MAGIC)] != MCAP0_MAGIC[: len(content)]:
        raise CorruptEpisode(
            f"{name} starts with {content[:8]!r}, an MCAP file with {MCAP0_MAGIC!r}; "
            "give an episode file written by `gaitpref record`"
        )


def checked_summary(content: bytes, name: str) -> list[McapRecord]:
    """Compare the checksums that cover all bytes, then parse the summary section.

    Raises:
        CorruptEpisode: it is no MCAP file.
        TruncatedEpisode: it has no end.
        UnsupportedSchema: it has no checksums.
        ValueError: a checksum is wrong.
    """
    require_magic(content, name)
    start = summary_start(content, len(content), name)
    data_end = start - _DATA_END_BYTES
    if content[data_end : start - 4] != _DATA_END_HEAD:
        raise ValueError(f"the summary cannot start at byte {start}")
    (data_crc,) = struct.unpack_from("<I", content, start - 4)
    (crc,) = struct.unpack_from("<I", content, len(content) - 12)
    view = memoryview(content)
    for section, stored, part in (
        ("summary", crc, view[start : -len(MCAP0_MAGIC) - 4]),
        ("data", data_crc, view[:data_end]),
    ):
        if stored == zlib.crc32(part):
            continue
        if stored == 0:
            raise UnsupportedSchema(
                f"{name} has no checksum of its {section}, so another program "
                "wrote it; use the file that `gaitpref record` wrote"
            )
        raise ValueError(f"the checksum of the {section} is wrong")
    return summary_records(content[start:])


def summary_records(section: bytes) -> list[McapRecord]:
    """Parse a summary section, with the footer behind it."""
    # No chunk belongs here, and the library would unpack one without a limit.
    return list(
        StreamReader(BytesIO(section), skip_magic=True, emit_chunks=True).records
    )


def chunk_content(block: bytes | memoryview) -> bytes | memoryview:
    """The records in a chunk, uncompressed and compared with its checksum.

    Args:
        block: The chunk record, and anything behind it.

    Raises:
        ValueError: it is no chunk, is damaged, or unpacks to too much.
    """
    opcode, length, _, _, size, crc, name_size = struct.unpack_from("<BQQQQII", block)
    name = bytes(block[41 : 41 + name_size])
    start = 41 + name_size + 8
    (stored_size,) = struct.unpack_from("<Q", block, start - 8)
    if opcode != Opcode.CHUNK or length != start - 9 + stored_size:
        raise ValueError("a chunk is not where it should be")
    if start + stored_size > len(block):
        raise ValueError("a chunk reaches beyond its end")
    content = memoryview(block)[start : start + stored_size]
    if name == b"zstd":
        try:
            content = unpack_zstd(content, size, EPISODE_CHUNK_BYTES)
        except ValueError as error:
            raise ValueError(f"a chunk is damaged: {error}") from error
    elif name:
        raise ValueError(f"a chunk is compressed with {name[:20]!r}")
    if len(content) != size or zlib.crc32(content) != crc:
        raise ValueError("the checksum of the messages is wrong")
    return content


def chunk_messages(
    block: bytes, index: ChunkIndex, records: dict[int, np.dtype]
) -> dict[int, np.ndarray]:
    """View the messages of a chunk, found through its message indexes.

    Args:
        block: The chunk record and the message indexes behind it.
        index: What the summary says of the chunk.
        records: Channels and what their message records look like.
    """
    content = chunk_content(block)
    found: dict[int, np.ndarray] = {}
    for channel, offset in index.message_index_offsets.items():
        if channel in records:
            position = offset - index.chunk_start_offset
            offsets = _message_offsets(block, position, channel)
            found[channel] = _messages(content, offsets, channel, records[channel])
    return found


def _message_offsets(block: bytes, position: int, channel: int) -> np.ndarray:
    stream = record_at(block, position, Opcode.MESSAGE_INDEX)
    index_channel, size = stream.read2(), stream.read4()
    entries = np.frombuffer(stream.read(size), dtype="<u8").reshape(-1, 2)
    if index_channel != channel:
        raise ValueError("the message index belongs to another channel")
    return entries[:, 1].astype(np.int64)


def _messages(
    content: bytes | memoryview, offsets: np.ndarray, channel: int, dtype: np.dtype
) -> np.ndarray:
    start = int(offsets[0])
    if start < 0:
        raise ValueError("the message index points before the chunk")
    if not np.array_equal(offsets, start + np.arange(len(offsets)) * dtype.itemsize):
        raise ValueError("the messages are not of equal size, one behind the other")
    records = np.frombuffer(content, dtype=dtype, count=len(offsets), offset=start)
    for member, expected in (
        ("opcode", Opcode.MESSAGE),
        ("length", schema.record_length(dtype)),
        ("channel", channel),
        ("cdr", tuple(schema.CDR_HEADER)),
    ):
        if not np.all(records[member] == expected):
            raise ValueError(f"a message of channel {channel} has a wrong {member}")
    return records


def only(summary: list[McapRecord], kind: type[RecordT]) -> RecordT:
    """The one record of a kind."""
    found = [record for record in summary if isinstance(record, kind)]
    if len(found) != 1:
        raise ValueError(f"{len(found)} records of kind {kind.__name__}, expected 1")
    return found[0]


def record_at(content: bytes, offset: int, opcode: int) -> ReadDataStream:
    """A stream over the body of the record at `offset`, and nothing behind it."""
    if offset < 0:
        raise ValueError(f"no record can be at byte {offset}")
    found, length = struct.unpack_from("<BQ", content, offset)
    end = offset + 9 + length
    if found != opcode or end > len(content):
        raise ValueError(f"no {Opcode(opcode).name} record at byte {offset}")
    return ReadDataStream(BytesIO(content[offset + 9 : end]))
