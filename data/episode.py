"""Reads episode files; the records themselves are re-exported from here.

Nothing in a file is believed before its checksums were compared, and no count in it
makes this code allocate more than the file's own size.

Shapes: T steps of the episode, F columns of the feature row.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, cast

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
)
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from data import schema
from data.episode_records import END_REASONS as END_REASONS
from data.episode_records import EndReason as EndReason
from data.episode_records import Episode as Episode
from data.episode_records import EpisodeMeta as EpisodeMeta
from data.errors import (
    CorruptEpisode,
    EpisodeError,
    TruncatedEpisode,
    UnsupportedSchema,
)
from data.features import features_sha256

_FOOTER_BYTES = 29
_DATA_END_BYTES = 13
_DATA_END_HEAD = struct.pack("<BQ", Opcode.DATA_END, 4)


def read_episode(path: Path) -> Episode:
    """Read a whole episode.

    Raises:
        OSError: the file cannot be read.
        TruncatedEpisode: the file has no end.
        CorruptEpisode: the file is not what was written.
        UnsupportedSchema: another version, or another program, wrote the file.
    """
    return decode_episode(path.read_bytes(), str(path))


def read_features(path: Path) -> np.ndarray:
    """Read only the feature rows [T, F] of an episode, float32 and read-only.

    Raises:
        OSError, EpisodeError: as for `read_episode`.
    """
    return decode_features(path.read_bytes(), str(path))


def decode_episode(content: bytes, name: str) -> Episode:
    """The episode in the bytes of a file; `name` is what errors call it.

    Raises:
        EpisodeError: as for `read_episode`.
    """
    with _corrupt_if_unreadable(name):
        parts = _open(content, name)
        steps, final = parts.steps["body"], parts.final["body"]
        end_reason = parts.metadata["end_reason"]
        for flag in ("terminated", "truncated"):
            expected = np.zeros(len(steps), dtype=np.uint8)
            expected[-1] = flag == end_reason
            if not np.array_equal(steps[flag], expected):
                raise ValueError(f"{flag} flags contradict end_reason {end_reason!r}")
        states = {
            field: np.concatenate([steps[field], final[field]])
            for field in ("qpos", "qvel", "obs")
        }
        rows = {
            field: np.array(steps[field])
            for field in ("action", "ctrl", "features", "reward")
        }
        return Episode(
            **states,
            **rows,
            end_reason=cast(EndReason, end_reason),
            meta=EpisodeMeta.from_strings(parts.metadata),
            mjcf=_attachment(content, parts.summary).decode(),
        )


def decode_features(content: bytes, name: str) -> np.ndarray:
    """The feature rows [T, F] in the bytes of a file, float32 and read-only.

    Raises:
        EpisodeError: as for `read_episode`.
    """
    with _corrupt_if_unreadable(name):
        features = np.array(_open(content, name).steps["body"]["features"])
        features.setflags(write=False)
        return features


@contextmanager
def _corrupt_if_unreadable(name: str) -> Iterator[None]:
    """Whatever parsing foreign bytes raises is one thing to a caller."""
    try:
        yield
    except EpisodeError:
        raise
    except Exception as error:
        found = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise CorruptEpisode(
            f"{name} is damaged ({found}); restore it from a copy or record it again"
        ) from error


@dataclass(frozen=True, eq=False)
class _Parts:
    """What both readers need of a file; views into its bytes."""

    steps: np.ndarray
    """[T] of `schema.STEP_RECORD`."""
    final: np.ndarray
    """[1] of `schema.FINAL_RECORD`."""
    metadata: dict[str, str]
    summary: list[McapRecord]


def _open(content: bytes, name: str) -> _Parts:
    """Check the file and find its messages."""
    summary = _checked_summary(content, name)
    channels = _supported_channels(summary, name)
    metadata = _supported_metadata(content, summary, name)
    chunk_index = _only(summary, ChunkIndex)
    if chunk_index.compression:
        raise UnsupportedSchema(
            f"{name} is compressed with {chunk_index.compression[:20]!r}, episodes are "
            "stored uncompressed; run `mcap decompress` on it"
        )
    start = chunk_index.chunk_start_offset
    chunk = Chunk.read(_record_at(content, start, Opcode.CHUNK))
    if zlib.crc32(chunk.data) != chunk.uncompressed_crc:
        raise ValueError("the checksum of the messages is wrong")

    index = chunk_index.message_index_offsets
    steps = _messages(content, chunk.data, index, channels[0], schema.STEP_RECORD)
    final = _messages(content, chunk.data, index, channels[1], schema.FINAL_RECORD)
    if len(final) != 1:
        raise ValueError(f"{len(final)} final states, an episode has 1")
    if metadata["n_steps"] != str(len(steps)):
        raise ValueError(f"{len(steps)} steps, promised {metadata['n_steps'][:20]}")
    if not np.array_equal(steps["body"]["step"], np.arange(len(steps))):
        raise ValueError("the steps are not numbered 0, 1, 2, ...")
    return _Parts(steps, final, metadata, summary)


def _checked_summary(content: bytes, name: str) -> list[McapRecord]:
    """Compare the checksums that cover all bytes, then parse the summary section."""
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
    if (opcode, length) != (Opcode.FOOTER, _FOOTER_BYTES - 9):
        raise ValueError("the footer is not where it should be")
    if not len(magic) + _DATA_END_BYTES <= start <= footer_start:
        raise ValueError(f"the summary cannot start at byte {start}")
    if zlib.crc32(memoryview(content)[start : -len(magic) - 4]) != crc:
        raise ValueError("the checksum of the summary is wrong")
    data_end = start - _DATA_END_BYTES
    expected = _DATA_END_HEAD + struct.pack(
        "<I", zlib.crc32(memoryview(content)[:data_end])
    )
    if content[data_end:start] != expected:
        raise ValueError("the checksum of the data is wrong")
    return list(StreamReader(BytesIO(content[start:]), skip_magic=True).records)


def _supported_channels(summary: list[McapRecord], name: str) -> tuple[int, int]:
    """Numbers of the step and the final channel, if their schemas are known."""
    schemas = {s.id: s for s in summary if isinstance(s, Schema)}
    by_topic = {c.topic: c for c in summary if isinstance(c, Channel)}
    numbers: list[int] = []
    for topic, expected in (
        (schema.STEP_TOPIC, schema.STEP_SCHEMA),
        (schema.FINAL_TOPIC, schema.FINAL_SCHEMA),
    ):
        if topic not in by_topic:
            raise UnsupportedSchema(
                f"{name} has no topic {topic}, so it is no episode; "
                "give a file written by `gaitpref record`"
            )
        channel = by_topic[topic]
        found = schemas[channel.schema_id].name
        if found != expected or channel.message_encoding != "cdr":
            raise UnsupportedSchema(
                f"{name} holds {found[:80]!r} on {topic}, this version reads "
                f"{expected!r}; read it with the version of gaitpref that wrote it"
            )
        numbers.append(channel.id)
    return numbers[0], numbers[1]


def _supported_metadata(
    content: bytes, summary: list[McapRecord], name: str
) -> dict[str, str]:
    offset = _only(summary, MetadataIndex).offset
    metadata = Metadata.read(_record_at(content, offset, Opcode.METADATA)).metadata
    for key, expected in (
        ("format_version", str(schema.FORMAT_VERSION)),
        ("schema_sha256", schema.schema_sha256()),
        ("features_sha256", features_sha256()),
    ):
        if metadata[key] != expected:
            raise UnsupportedSchema(
                f"{name} has {key} {metadata[key][:64]}, this version reads "
                f"{expected}; read it with the version of gaitpref that wrote it"
            )
    return metadata


def _messages(
    content: bytes,
    chunk: bytes,
    index_offsets: dict[int, int],
    channel: int,
    dtype: np.dtype,
) -> np.ndarray:
    """View the messages of one channel, found through its message index."""
    stream = _record_at(content, index_offsets[channel], Opcode.MESSAGE_INDEX)
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


def _attachment(content: bytes, summary: list[McapRecord]) -> bytes:
    offset = _only(summary, AttachmentIndex).offset
    return Attachment.read(_record_at(content, offset, Opcode.ATTACHMENT)).data


def _only(summary: list[McapRecord], kind: type[Any]) -> Any:
    """The one record of a kind."""
    found = [record for record in summary if isinstance(record, kind)]
    if len(found) != 1:
        raise ValueError(f"{len(found)} records of kind {kind.__name__}, expected 1")
    return found[0]


def _record_at(content: bytes, offset: int, opcode: int) -> ReadDataStream:
    """A stream over the body of the record at `offset`, and nothing behind it."""
    found, length = struct.unpack_from("<BQ", content, offset)
    end = offset + 9 + length
    if found != opcode or offset < 0 or end > len(content):
        raise ValueError(f"no {Opcode(opcode).name} record at byte {offset}")
    return ReadDataStream(BytesIO(content[offset + 9 : end]))
