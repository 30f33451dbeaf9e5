"""Reads episode files; the records themselves are re-exported from here.

Nothing in a file is believed before its checksums were compared, and no count in it
makes this code allocate more than the file's own size.

Shapes: T steps of the episode, F columns of the feature row.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
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

from data import schema
from data.episode_records import END_REASONS as END_REASONS
from data.episode_records import EndReason as EndReason
from data.episode_records import Episode as Episode
from data.episode_records import EpisodeMeta as EpisodeMeta
from data.errors import CorruptEpisode, EpisodeError, UnsupportedSchema
from data.features import features_sha256
from data.mcap_records import checked_summary, messages, only, record_at


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
    summary = checked_summary(content, name)
    channels = _supported_channels(summary, name)
    metadata = _supported_metadata(content, summary, name)
    chunk_index = only(summary, ChunkIndex)
    if chunk_index.compression:
        raise UnsupportedSchema(
            f"{name} is compressed with {chunk_index.compression[:20]!r}, episodes are "
            "stored uncompressed; use the file that `gaitpref record` wrote"
        )
    start = chunk_index.chunk_start_offset
    chunk = Chunk.read(record_at(content, start, Opcode.CHUNK))
    if zlib.crc32(chunk.data) != chunk.uncompressed_crc:
        raise ValueError("the checksum of the messages is wrong")

    index = chunk_index.message_index_offsets
    steps = messages(content, chunk.data, index, channels[0], schema.STEP_RECORD)
    final = messages(content, chunk.data, index, channels[1], schema.FINAL_RECORD)
    if len(final) != 1:
        raise ValueError(f"{len(final)} final states, an episode has 1")
    if metadata["n_steps"] != str(len(steps)):
        raise ValueError(f"{len(steps)} steps, promised {metadata['n_steps'][:20]}")
    if not np.array_equal(steps["body"]["step"], np.arange(len(steps))):
        raise ValueError("the steps are not numbered 0, 1, 2, ...")
    return _Parts(steps, final, metadata, summary)


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
    offset = only(summary, MetadataIndex).offset
    metadata = Metadata.read(record_at(content, offset, Opcode.METADATA)).metadata
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


def _attachment(content: bytes, summary: list[McapRecord]) -> bytes:
    offset = only(summary, AttachmentIndex).offset
    return Attachment.read(record_at(content, offset, Opcode.ATTACHMENT)).data
