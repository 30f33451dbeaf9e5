"""Messages of a ROS 2 bag in MCAP, as they were written; a file without an end is read
as far as it goes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import IO, BinaryIO, cast

import mcap.records
from mcap.data_stream import ReadDataStream
from mcap.records import Channel, Chunk
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC

from data.files.files import BoundedFile, open_regular
from data.files.limits import BAG_CHUNK_BYTES

from .bag_records import Undecoded, in_order, messages_in, records_of, summary_of
from .bag_sqlite import Stored

MAGIC = MCAP0_MAGIC


def mcap_messages(path: Path, topics: list[str]) -> Iterator[Stored]:
    """Every message of `topics`, as they were written.

    Raises:
        ValueError, McapError, EndOfFile: the file breaks off or is damaged.
    """
    with open_regular(path) as opened:
        for schema, channel, message in _undecoded(_in_pieces(opened), topics):
            if channel.message_encoding != "cdr":
                raise ValueError(
                    f"{channel.topic} is written in {channel.message_encoding!r}, not "
                    "in cdr"
                )
            if schema is None:
                raise ValueError(f"{channel.topic} does not say what it consists of")
            told = schema.encoding == "ros2msg" and schema.data
            yield Stored(
                channel.topic,
                schema.name,
                schema.data.decode() if told else None,
                message.log_time,
                message.data,
            )


def mcap_topics(path: Path) -> list[str]:
    """Names of all topics, as far as the file can be read."""
    names: set[str] = set()
    with open_regular(path) as opened:
        try:
            for record in in_order(_in_pieces(opened)):
                if isinstance(record, Channel):
                    names.add(record.topic)
        except Exception:
            # What breaks off was told when it was read.
            pass
    return sorted(names)


def _in_pieces(file: BinaryIO) -> IO[bytes]:
    # It does all that an open file does.
    return cast(IO[bytes], BoundedFile(file, BAG_CHUNK_BYTES))


def _undecoded(file: IO[bytes], topics: list[str]) -> Iterator[Undecoded]:
    """Messages of `topics` as they were written.

    Found by the index where there is one, so that pictures are not unpacked, else by
    reading everything from the first byte on.
    """
    summary = _summary(file)
    if summary is None or not summary.chunk_indexes:
        yield from messages_in(in_order(file), topics)
        return
    wanted = {id for id, c in summary.channels.items() if c.topic in topics}
    # One chunk at a time: mcap's own reader would hold all of them.
    for index in sorted(summary.chunk_indexes, key=lambda i: i.chunk_start_offset):
        held = index.message_index_offsets
        if held and wanted.isdisjoint(held):
            continue
        file.seek(index.chunk_start_offset + 9)
        chunk = Chunk.read(ReadDataStream(file))
        for record in records_of(chunk):
            if isinstance(record, mcap.records.Message) and record.channel_id in wanted:
                channel = summary.channels[record.channel_id]
                yield summary.schemas.get(channel.schema_id), channel, record


def _summary(file: IO[bytes]) -> Summary | None:
    try:
        return summary_of(file)
    except Exception:
        # Without an end, the bytes where the index should be are anything.
        return None
