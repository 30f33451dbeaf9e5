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
from mcap.records import McapRecord
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from data import schema
from data.errors import CorruptEpisode, TruncatedEpisode, UnsupportedSchema

_FOOTER_BYTES = 29
_DATA_END_BYTES = 13
_DATA_END_HEAD = struct.pack("<BQ", Opcode.DATA_END, 4)

RecordT = TypeVar("RecordT", bound=McapRecord)


def checked_summary(content: bytes, name: str) -> list[McapRecord]:
    """Compare the checksums that cover all bytes, then parse the summary section.

    Raises:
        CorruptEpisode: it is no MCAP file.
        TruncatedEpisode: it has no end.
        UnsupportedSchema: it has no checksums.
        ValueError: a checksum is wrong.
    """
    magic = MCAP0_MAGIC
    if content[: len(magic)] != magic[: len(content)]:
        raise CorruptEpisode(
            f"{name} starts with {content[:8]!r}, an MCAP file with {magic!r}; "
            "give an episode file written by `gaitpref record`"
        )
    footer_start = len(content) - _FOOTER_BYTES - len(magic)
    if not content.endswith(magic) or footer_start < len(magic) + _DATA_END_BYTES:
        raise TruncatedEpisode(
            f"{name} stops after {len(content)} bytes without the end of an MCAP file; "
            "copy it again, or delete it and record again"
        )
    opcode, length, start, _, crc = struct.unpack_from("<BQQQI", content, footer_start)
    if start == 0:
        raise UnsupportedSchema(
            f"{name} has no summary, so another program wrote it; "
            "use the file that `gaitpref record` wrote"
        )
    if (opcode, length) != (Opcode.FOOTER, _FOOTER_BYTES - 9):
        raise ValueError("the footer is not where it should be")
    data_end = start - _DATA_END_BYTES
    if start > footer_start or content[data_end : start - 4] != _DATA_END_HEAD:
        raise ValueError(f"the summary cannot start at byte {start}")
    (data_crc,) = struct.unpack_from("<I", content, start - 4)
    view = memoryview(content)
    for section, stored, part in (
        ("summary", crc, view[start : -len(magic) - 4]),
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
    return list(StreamReader(BytesIO(content[start:]), skip_magic=True).records)


def messages(
    content: bytes,
    chunk: bytes,
    index_offsets: dict[int, int],
    channel: int,
    dtype: np.dtype,
) -> np.ndarray:
    """View the messages of one channel, found through its message index."""
    stream = record_at(content, index_offsets[channel], Opcode.MESSAGE_INDEX)
    index_channel, size = stream.read2(), stream.read4()
    entries = np.frombuffer(stream.read(size), dtype="<u8").reshape(-1, 2)
    offsets = entries[:, 1].astype(np.int64)
    start = int(offsets[0])
    if index_channel != channel or start < 0:
        raise ValueError("the message index belongs to another channel")
    if not np.array_equal(offsets, start + np.arange(len(offsets)) * dtype.itemsize):
        raise ValueError("the messages are not of equal size, one behind the other")
    records = np.frombuffer(chunk, dtype=dtype, count=len(offsets), offset=start)
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
    found, length = struct.unpack_from("<BQ", content, offset)
    end = offset + 9 + length
    if found != opcode or offset < 0 or end > len(content):
        raise ValueError(f"no {Opcode(opcode).name} record at byte {offset}")
    return ReadDataStream(BytesIO(content[offset + 9 : end]))
