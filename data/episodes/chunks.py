"""The messages of an episode as MCAP chunks, made in bulk from its arrays.

Several chunks an episode: a writer killed half-way leaves the whole ones, and a reader
of a short window leaves the others alone.

Shapes: T steps of the episode.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import zstandard
from mcap.opcode import Opcode
from mcap.records import ChunkIndex

from . import schema
from .episode_records import Episode

STEP_CHANNEL = 1
FINAL_CHANNEL = 2
CHUNK_STEPS = 128
"""2.6 s at 50 Hz, 0.13 MB: as much may be lost, and as much is read for one clip."""
ZSTD_LEVEL = 3

Compression = Literal["", "zstd"]
"""Nothing for data still being trained on; zstd saves a fifth where space is short."""


@dataclass(frozen=True, eq=False)
class EncodedChunk:
    """A chunk record and the message indexes behind it."""

    head: bytes
    """The chunk record up to its messages."""
    stored: Sequence[bytes | memoryview]
    """The messages as they are in the file."""
    stored_crc: int
    """CRC-32 of them."""
    indexes: bytes
    """The message indexes behind the chunk."""
    length: int
    """Bytes of the chunk record."""
    index_lengths: dict[int, int]
    """Bytes of the message index of each channel, in order."""
    compression: Compression
    compressed_size: int
    uncompressed_size: int
    start_ns: int
    end_ns: int

    def index(self, offset: int) -> ChunkIndex:
        """What the summary says of the chunk if it starts at byte `offset`."""
        offsets: dict[int, int] = {}
        end = offset + self.length
        for channel, length in self.index_lengths.items():
            offsets[channel] = end
            end += length
        return ChunkIndex(
            chunk_length=self.length,
            chunk_start_offset=offset,
            compression=self.compression,
            compressed_size=self.compressed_size,
            message_end_time=self.end_ns,
            message_index_length=end - offset - self.length,
            message_index_offsets=offsets,
            message_start_time=self.start_ns,
            uncompressed_size=self.uncompressed_size,
        )


def encode_chunks(
    episode: Episode, preamble: bytes, compression: Compression
) -> Iterator[EncodedChunk]:
    """The chunks of an episode; the first begins with `preamble`, the last ends with
    the final state."""
    times_ns = step_times_ns(episode.num_steps, episode.meta.control_dt_s)
    steps, final = _records(episode, times_ns)
    step_bytes, final_bytes = (a.view(np.uint8).data for a in (steps, final))
    size = steps.itemsize
    compressor = zstandard.ZstdCompressor(level=ZSTD_LEVEL) if compression else None
    for first in range(0, episode.num_steps, CHUNK_STEPS):
        stop = min(first + CHUNK_STEPS, episode.num_steps)
        head = preamble if first == 0 else b""
        parts: list[bytes | memoryview] = [head, step_bytes[first * size : stop * size]]
        offsets = len(head) + np.arange(stop - first + 1) * size
        indexes = {
            STEP_CHANNEL: _message_index(
                STEP_CHANNEL, times_ns[first:stop], offsets[:-1]
            )
        }
        last = stop == episode.num_steps
        if last:
            parts.append(final_bytes)
            indexes[FINAL_CHANNEL] = _message_index(
                FINAL_CHANNEL, times_ns[-1:], offsets[-1:]
            )
        end_ns = int(times_ns[stop if last else stop - 1])
        yield _chunk(parts, indexes, compressor, int(times_ns[first]), end_ns)


def step_times_ns(num_steps: int, control_dt_s: float) -> np.ndarray:
    """[T + 1] uint64 log times: simulated nanoseconds since the reset."""
    # A float cannot hold a duration of days to the nanosecond, an integer step can.
    return np.arange(num_steps + 1, dtype=np.uint64) * np.uint64(
        round(control_dt_s * 1e9)
    )


def _records(episode: Episode, times_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Message records of the steps [T] and of the final state [1]."""
    num_steps = episode.num_steps
    steps = np.zeros(num_steps, dtype=schema.STEP_RECORD)
    final = np.zeros(1, dtype=schema.FINAL_RECORD)
    for records, channel, sequence in (
        (steps, STEP_CHANNEL, np.arange(num_steps)),
        (final, FINAL_CHANNEL, num_steps),
    ):
        records["opcode"] = Opcode.MESSAGE
        records["length"] = schema.record_length(records.dtype)
        records["channel"] = channel
        records["sequence"] = sequence
        records["log_time"] = records["publish_time"] = times_ns[sequence]
        records["cdr"] = tuple(schema.CDR_HEADER)
    for name in ("action", "ctrl", "features", "reward"):
        steps["body"][name] = getattr(episode, name)
    for name in ("qpos", "qvel", "obs"):
        steps["body"][name] = getattr(episode, name)[:-1]
        final["body"][name] = getattr(episode, name)[-1]
    steps["body"]["step"] = np.arange(num_steps)
    if episode.end_reason != "aborted":
        steps["body"][episode.end_reason][-1] = 1
    return steps, final


def _chunk(
    content: list[bytes | memoryview],
    indexes: dict[int, bytes],
    compressor: zstandard.ZstdCompressor | None,
    start_ns: int,
    end_ns: int,
) -> EncodedChunk:
    size, crc = 0, 0
    for part in content:
        size += len(part)
        crc = zlib.crc32(part, crc)
    compression: Compression = ""
    stored: list[bytes | memoryview] = [*content]
    stored_size, stored_crc = size, crc
    if compressor is not None:
        compression = "zstd"
        packed = compressor.compress(b"".join(content))
        stored = [packed]
        stored_size, stored_crc = len(packed), zlib.crc32(packed)
    name = compression.encode()
    # The record by hand: the library's would copy all messages once more.
    body = struct.pack("<QQQII", start_ns, end_ns, size, crc, len(name)) + name
    body += struct.pack("<Q", stored_size)
    length = len(body) + stored_size
    return EncodedChunk(
        head=struct.pack("<BQ", Opcode.CHUNK, length) + body,
        stored=stored,
        stored_crc=stored_crc,
        indexes=b"".join(indexes.values()),
        length=9 + length,
        index_lengths={channel: len(index) for channel, index in indexes.items()},
        compression=compression,
        compressed_size=stored_size,
        uncompressed_size=size,
        start_ns=start_ns,
        end_ns=end_ns,
    )


def _message_index(channel: int, times_ns: np.ndarray, offsets: np.ndarray) -> bytes:
    entries = np.stack([times_ns, offsets.astype(np.uint64)], axis=1).astype("<u8")
    size = entries.nbytes
    return (
        struct.pack("<BQHI", Opcode.MESSAGE_INDEX, size + 6, channel, size)
        + entries.tobytes()
    )
