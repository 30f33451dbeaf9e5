"""Records of an MCAP file that somebody else wrote, unpacked within a limit."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import IO

from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    Footer,
    McapRecord,
    Message,
    Schema,
)
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.summary import Summary

from data.files.limits import BAG_CHUNK_BYTES
from data.files.unpacking import unpack_lz4, unpack_zstd

_END_BYTES = 37
"""Bytes of the last record and of what marks the end of a file."""

Undecoded = tuple[Schema | None, Channel, Message]
"""A message as it was written, and what it is."""


def records_of(chunk: Chunk) -> list[McapRecord]:
    """What a chunk holds; its checksum is compared.

    Raises:
        ValueError: it unpacks to more than it claims, or than the limit.
        McapError: it is damaged.
    """
    data, size = chunk.data, chunk.uncompressed_size
    match chunk.compression:
        case "zstd":
            data = unpack_zstd(data, size, BAG_CHUNK_BYTES)
        case "lz4":
            data = unpack_lz4(data, size, BAG_CHUNK_BYTES)
        case "":
            pass
        case other:
            raise ValueError(f"it is packed with {other[:20]}, not with zstd or lz4")
    return breakup_chunk(replace(chunk, compression="", data=data), validate_crc=True)


def in_order(file: IO[bytes]) -> Iterator[McapRecord]:
    """All records from the first byte on, those in chunks too, without an index.

    Raises:
        ValueError, McapError, EndOfFile: the file breaks off or is damaged.
    """
    file.seek(0)
    reader = StreamReader(
        file, emit_chunks=True, validate_crcs=True, record_size_limit=BAG_CHUNK_BYTES
    )
    for record in reader.records:
        if isinstance(record, Chunk):
            yield from records_of(record)
        else:
            yield record


def summary_of(file: IO[bytes]) -> Summary | None:
    """The index at the end of a file; None without one.

    mcap's own reader of it unpacks a chunk it finds there, whatever that holds.

    Raises:
        ValueError, McapError, EndOfFile, OSError: the bytes there are anything else.
    """
    file.seek(-_END_BYTES, os.SEEK_END)
    footer = next(StreamReader(file, skip_magic=True, emit_chunks=True).records)
    if not isinstance(footer, Footer) or not footer.summary_start:
        return None
    file.seek(footer.summary_start)
    found = Summary()
    reader = StreamReader(
        file, skip_magic=True, emit_chunks=True, record_size_limit=BAG_CHUNK_BYTES
    )
    for record in reader.records:
        match record:
            case Schema():
                found.schemas[record.id] = record
            case Channel():
                found.channels[record.id] = record
            case ChunkIndex():
                found.chunk_indexes.append(record)
            case Chunk():
                return None
    return found


def messages_in(
    records: Iterable[McapRecord], topics: list[str]
) -> Iterator[Undecoded]:
    """Messages of `topics` among records that tell of their channels before."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    for record in records:
        match record:
            case Schema():
                schemas[record.id] = record
            case Channel():
                channels[record.id] = record
            case Message():
                channel = channels[record.channel_id]
                if channel.topic in topics:
                    yield schemas.get(channel.schema_id), channel, record
