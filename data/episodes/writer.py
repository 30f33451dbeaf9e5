"""Writes one episode as one MCAP file, in bulk.

The same episode gives the same bytes: no clock, no library version, and unless asked
for no compression (its output depends on the compressor's version, and noisy floats
shrink by a fifth at best). So a file can be named by its hash. Every byte is covered by
a checksum. What a reader needs first, metadata and model, comes first, so that a file
cut short still says what it is.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Sequence
from functools import cache, lru_cache

from mcap.data_stream import RecordBuilder
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
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

from data.features import JOINTS, features_sha256

from . import schema
from .chunks import FINAL_CHANNEL, STEP_CHANNEL, Compression, encode_chunks
from .crc import combined
from .episode_records import Episode
from .model_store import model_sha256

MJCF_NAME = "model/scene.xml"
_MJCF_TYPE = "application/xml"
MATE_NAME = "team/mate.mcap"
"""The attached file of the other robot of a team, which goes without the model."""
_MATE_TYPE = "application/octet-stream"
METADATA_NAME = "episode"
MODEL_KEY = "mjcf_sha256"
"""Metadata of a file without its model: the hash of the model."""


def encode_episode(
    episode: Episode, *, compression: Compression = "", model_apart: bool = False
) -> bytes:
    """The bytes of the episode's MCAP file.

    With `model_apart` they only name the robot's model by its hash: who writes them
    keeps it in a `ModelStore`.
    """
    schemas, channels = _fixed_records()
    metadata = Metadata(METADATA_NAME, _metadata(episode, model_apart))

    section = _Section()
    section.append(MCAP0_MAGIC, _join([Header(profile="", library="gaitpref")]))
    attached = [] if model_apart else [_append_model(section, episode.mjcf)]
    if episode.mate is not None:
        attached.append(_append_mate(section, episode.mate, compression))
    metadata_index = MetadataIndex(*section.append(_join([metadata])), METADATA_NAME)
    chunk_indexes: list[ChunkIndex] = []
    for chunk in encode_chunks(episode, schemas + channels, compression):
        offset, _ = section.append(chunk.head)
        section.append_checked(chunk.stored, chunk.stored_crc)
        section.append(chunk.indexes)
        chunk_indexes.append(chunk.index(offset))
    section.append(_join([DataEnd(section.crc)]))
    groups = [
        schemas,
        channels,
        _join([_statistics(episode, chunk_indexes, len(attached))]),
        _join(chunk_indexes),
        *(_join([index]) for index in attached),
        _join([metadata_index]),
    ]
    return b"".join([*section.parts, _summary(groups, section.size)])


def _append_model(section: _Section, mjcf: str) -> AttachmentIndex:
    """Put the model of the robot into the file; gives where it is."""
    attachment, size = _attachment(mjcf)
    return AttachmentIndex(
        *section.append(attachment),
        log_time=0,
        create_time=0,
        data_size=size,
        name=MJCF_NAME,
        media_type=_MJCF_TYPE,
    )


def _append_mate(
    section: _Section, mate: Episode, compression: Compression
) -> AttachmentIndex:
    """Put the file of the other robot into the file; gives where it is."""
    content = encode_episode(mate, compression=compression, model_apart=True)
    return AttachmentIndex(
        *section.append(_join([Attachment(0, 0, MATE_NAME, _MATE_TYPE, content)])),
        log_time=0,
        create_time=0,
        data_size=len(content),
        name=MATE_NAME,
        media_type=_MATE_TYPE,
    )


class _Section:
    """The growing data section: its bytes, their number and their checksum."""

    def __init__(self) -> None:
        self.parts: list[bytes | memoryview] = []
        self.size = 0
        self.crc = 0

    def append(self, *parts: bytes | memoryview) -> tuple[int, int]:
        """Add bytes; gives their offset in the file and their number."""
        start = self.size
        self.parts += parts
        for part in parts:
            self.size += len(part)
            self.crc = zlib.crc32(part, self.crc)
        return start, self.size - start

    def append_checked(self, parts: Sequence[bytes | memoryview], crc: int) -> None:
        """Add bytes whose checksum is known."""
        size = sum(map(len, parts))
        self.parts += parts
        self.size += size
        self.crc = combined(self.crc, crc, size)


@lru_cache(maxsize=8)
def _attachment(mjcf: str) -> tuple[bytes, int]:
    """The record of the robot, which most episodes share, and the size of its text."""
    content = mjcf.encode()
    return _join([Attachment(0, 0, MJCF_NAME, _MJCF_TYPE, content)]), len(content)


@cache
def _fixed_records() -> tuple[bytes, bytes]:
    """The schemas and the channels, equal in every file."""
    schemas = [
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
    names = {
        "feature_names": json.dumps(schema.feature_columns()),
        "joint_names": json.dumps(JOINTS),
    }
    channels = [
        Channel(STEP_CHANNEL, schema.STEP_TOPIC, "cdr", names, STEP_CHANNEL),
        Channel(FINAL_CHANNEL, schema.FINAL_TOPIC, "cdr", {}, FINAL_CHANNEL),
    ]
    return _join(schemas), _join(channels)


def _metadata(episode: Episode, model_apart: bool) -> dict[str, str]:
    version = schema.APART_VERSION if model_apart else schema.FORMAT_VERSION
    if episode.mate is not None:
        version = schema.TEAM_VERSION
    apart = {MODEL_KEY: model_sha256(episode.mjcf)} if model_apart else {}
    return {
        "format_version": str(version),
        "schema_sha256": schema.schema_sha256(),
        "features_sha256": features_sha256(),
        "end_reason": episode.end_reason,
        "n_steps": str(episode.num_steps),
        **apart,
        **episode.meta.to_strings(),
    }


def _statistics(
    episode: Episode, chunks: Sequence[ChunkIndex], attachments: int
) -> Statistics:
    return Statistics(
        attachment_count=attachments,
        channel_count=2,
        channel_message_counts={STEP_CHANNEL: episode.num_steps, FINAL_CHANNEL: 1},
        chunk_count=len(chunks),
        message_count=episode.num_steps + 1,
        message_end_time=chunks[-1].message_end_time,
        message_start_time=chunks[0].message_start_time,
        metadata_count=1,
        schema_count=2,
    )


def _summary(groups: list[bytes], start: int) -> bytes:
    """The summary section, its footer and the closing magic."""
    content = b""
    offsets: list[McapRecord] = []
    for group in groups:
        # The first byte of a record tells its kind.
        offsets.append(SummaryOffset(group[0], start + len(content), len(group)))
        content += group
    offset_start = start + len(content)
    content += _join(offsets)
    # The checksum covers the footer up to the checksum itself.
    footer = _join([Footer(start, offset_start, 0)])
    crc = zlib.crc32(content + footer[:-4])
    return content + _join([Footer(start, offset_start, crc)]) + MCAP0_MAGIC


def _join(records: Sequence[McapRecord]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()
