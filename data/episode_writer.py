"""Writes one episode as one MCAP file, in bulk.

The same episode gives the same bytes: no clock, no library version, no compression (its
output would depend on the compressor's version, and noisy floats shrink by a fifth at
best). So a file can be named by its hash. Every byte is covered by a checksum.

Shapes: T steps of the episode.
"""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

from data import schema
from data.episode_records import Episode
from data.features import JOINTS, features_sha256
from data.files import write_atomically

MJCF_NAME = "model/scene.xml"
METADATA_NAME = "episode"
STEP_CHANNEL = 1
FINAL_CHANNEL = 2


def write_episode(path: Path, episode: Episode) -> None:
    """Write `episode` to `path`, whole or not at all.

    Raises:
        OSError: the directory is missing, or the disk is full.
    """
    write_atomically(path, encode_episode(episode))


def encode_episode(episode: Episode) -> bytes:
    """The bytes of the episode's MCAP file."""
    schemas, channels = _schemas(), _channels()
    attachment = Attachment(0, 0, MJCF_NAME, "application/xml", episode.mjcf.encode())
    metadata = Metadata(METADATA_NAME, _metadata(episode))
    chunk, message_indexes = _chunk(episode, _join([*schemas, *channels]))

    section = _Section()
    section.append(MCAP0_MAGIC + _join([Header(profile="", library="gaitpref")]))
    attachment_index = AttachmentIndex(
        *section.append(_join([attachment])),
        log_time=0,
        create_time=0,
        data_size=len(attachment.data),
        name=attachment.name,
        media_type=attachment.media_type,
    )
    metadata_index = MetadataIndex(*section.append(_join([metadata])), METADATA_NAME)
    chunk_start, chunk_length = section.append(_join([chunk]))
    index_offsets = {
        channel_id: section.append(index)[0]
        for channel_id, index in message_indexes.items()
    }
    chunk_index = ChunkIndex(
        chunk_length=chunk_length,
        chunk_start_offset=chunk_start,
        compression=chunk.compression,
        compressed_size=len(chunk.data),
        message_end_time=chunk.message_end_time,
        message_index_length=section.size - chunk_start - chunk_length,
        message_index_offsets=index_offsets,
        message_start_time=chunk.message_start_time,
        uncompressed_size=chunk.uncompressed_size,
    )
    section.append(_join([DataEnd(section.crc)]))
    groups: list[list[McapRecord]] = [
        [*schemas],
        [*channels],
        [_statistics(episode, chunk)],
        [chunk_index],
        [attachment_index],
        [metadata_index],
    ]
    return b"".join([*section.parts, _summary(groups, section.size)])


class _Section:
    """The growing data section: its bytes, their number and their checksum."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.size = 0
        self.crc = 0

    def append(self, part: bytes) -> tuple[int, int]:
        """Add bytes; gives their offset in the file and their number."""
        start = self.size
        self.parts.append(part)
        self.size += len(part)
        self.crc = zlib.crc32(part, self.crc)
        return start, len(part)


def _schemas() -> list[Schema]:
    return [
        Schema(
            id=number,
            name=name,
            encoding="ros2msg",
            data=schema.message_text(f).encode(),
        )
        for number, name, f in (
            (STEP_CHANNEL, schema.STEP_SCHEMA, schema.STEP_FIELDS),
            (FINAL_CHANNEL, schema.FINAL_SCHEMA, schema.FINAL_FIELDS),
        )
    ]


def _channels() -> list[Channel]:
    names = {
        "feature_names": json.dumps(schema.feature_columns()),
        "joint_names": json.dumps(JOINTS),
    }
    return [
        Channel(STEP_CHANNEL, schema.STEP_TOPIC, "cdr", names, STEP_CHANNEL),
        Channel(FINAL_CHANNEL, schema.FINAL_TOPIC, "cdr", {}, FINAL_CHANNEL),
    ]


def _metadata(episode: Episode) -> dict[str, str]:
    return {
        "format_version": str(schema.FORMAT_VERSION),
        "schema_sha256": schema.schema_sha256(),
        "features_sha256": features_sha256(),
        "end_reason": episode.end_reason,
        "n_steps": str(episode.num_steps),
        **episode.meta.to_strings(),
    }


def _chunk(episode: Episode, preamble: bytes) -> tuple[Chunk, dict[int, bytes]]:
    """All messages behind `preamble`, and the message index of each channel."""
    num_steps = episode.num_steps
    steps = np.zeros(num_steps, dtype=schema.STEP_RECORD)
    final = np.zeros(1, dtype=schema.FINAL_RECORD)
    times_ns = step_times_ns(num_steps, episode.meta.control_dt_s)
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

    content = b"".join([preamble, steps.tobytes(), final.tobytes()])
    chunk = Chunk(
        compression="",
        data=content,
        message_start_time=int(times_ns[0]),
        message_end_time=int(times_ns[-1]),
        uncompressed_crc=zlib.crc32(content),
        uncompressed_size=len(content),
    )
    offsets = len(preamble) + np.arange(num_steps + 1) * steps.itemsize
    return chunk, {
        STEP_CHANNEL: _message_index(STEP_CHANNEL, times_ns[:-1], offsets[:-1]),
        FINAL_CHANNEL: _message_index(FINAL_CHANNEL, times_ns[-1:], offsets[-1:]),
    }


def step_times_ns(num_steps: int, control_dt_s: float) -> np.ndarray:
    """[T + 1] uint64 log times: simulated nanoseconds since the reset."""
    # A float cannot hold a duration of days to the nanosecond, an integer step can.
    return np.arange(num_steps + 1, dtype=np.uint64) * np.uint64(
        round(control_dt_s * 1e9)
    )


def _message_index(channel: int, times_ns: np.ndarray, offsets: np.ndarray) -> bytes:
    entries = np.stack([times_ns, offsets.astype(np.uint64)], axis=1).astype("<u8")
    size = entries.nbytes
    return (
        struct.pack("<BQHI", Opcode.MESSAGE_INDEX, size + 6, channel, size)
        + entries.tobytes()
    )


def _statistics(episode: Episode, chunk: Chunk) -> Statistics:
    return Statistics(
        attachment_count=1,
        channel_count=2,
        channel_message_counts={STEP_CHANNEL: episode.num_steps, FINAL_CHANNEL: 1},
        chunk_count=1,
        message_count=episode.num_steps + 1,
        message_end_time=chunk.message_end_time,
        message_start_time=chunk.message_start_time,
        metadata_count=1,
        schema_count=2,
    )


def _summary(groups: list[list[McapRecord]], start: int) -> bytes:
    """The summary section, its footer and the closing magic."""
    content = b""
    offsets: list[McapRecord] = []
    for group in groups:
        group_bytes = _join(group)
        offsets.append(
            SummaryOffset(group_bytes[0], start + len(content), len(group_bytes))
        )
        content += group_bytes
    offset_start = start + len(content)
    content += _join(offsets)
    # The checksum covers the footer up to the checksum itself.
    footer = _join([Footer(start, offset_start, 0)])
    crc = zlib.crc32(content + footer[:-4])
    return content + _join([Footer(start, offset_start, crc)]) + MCAP0_MAGIC


def _join(records: list[McapRecord] | list[Schema | Channel]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()
