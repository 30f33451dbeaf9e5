"""Reads episode files; the records themselves are re-exported from here.

Nothing in a file is believed before its checksums were compared, and no count in it
makes this code allocate more than the file's own size.

Shapes: T steps of the episode, F columns of the feature row.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import cast, get_args

import numpy as np
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
)

from data.errors import CorruptEpisode, GaitprefError, UnsupportedSchema
from data.features import features_sha256
from data.files.files import read_file
from data.files.limits import EPISODE_BYTES, EPISODE_UNPACKED_BYTES
from data.files.unpacking import require_size

from . import schema
from .chunks import Compression
from .episode_records import END_REASONS as END_REASONS
from .episode_records import EndReason as EndReason
from .episode_records import Episode as Episode
from .episode_records import EpisodeMeta as EpisodeMeta
from .mcap_records import checked_summary, chunk_messages, only, record_at
from .model_store import ModelStore, model_sha256
from .writer import MATE_NAME, MJCF_NAME, MODEL_KEY

_SHA256 = re.compile(r"[0-9a-f]{64}")


def read_episode(path: Path) -> Episode:
    """Read a whole episode; its model may lie in the data set that the file lies in.

    Raises:
        FileError, OSError: the file cannot be read.
        TruncatedEpisode: the file has no end.
        CorruptEpisode: the file is not what was written.
        UnsupportedSchema: another version, or another program, wrote the file.
    """
    # ROOT/rollouts/ab/FILE
    models = ModelStore(path.resolve().parent.parent.parent)
    return decode_episode(read_file(path, EPISODE_BYTES), str(path), models.text)


def decode_episode(
    content: bytes, name: str, model_of: Callable[[str], str] | None = None
) -> Episode:
    """The episode in the bytes of a file.

    Args:
        content: The file.
        name: What errors call it.
        model_of: Gives the model of a robot by its hash, where it is not in the file.

    Raises:
        EpisodeError: as for `read_episode`, or nobody gives its model.
    """
    with corrupt_if_unreadable(name):
        parts = _open(content, name)
        end_reason = parts.metadata["end_reason"]
        for flag in ("terminated", "truncated"):
            flags = parts.rows(flag)
            expected = np.zeros(len(flags), dtype=np.uint8)
            expected[-1] = flag == end_reason
            if not np.array_equal(flags, expected):
                raise ValueError(f"{flag} flags contradict end_reason {end_reason!r}")
        states = {
            field: parts.rows(field, with_final=True)
            for field in ("qpos", "qvel", "obs")
        }
        rows = {
            field: parts.rows(field)
            for field in ("action", "ctrl", "features", "reward")
        }
        mjcf = _mjcf(content, parts, name, model_of)
        return Episode(
            **states,
            **rows,
            end_reason=cast(EndReason, end_reason),
            meta=EpisodeMeta.from_strings(parts.metadata),
            mjcf=mjcf,
            mate=_mate(content, parts, name, mjcf),
        )


def model_apart(content: bytes, name: str) -> str:
    """Hash of the model that the bytes of a file go without; empty if it is inside.

    Raises:
        EpisodeError: as for `read_episode`.
    """
    with corrupt_if_unreadable(name):
        summary = checked_summary(content, name)
        return named_model(_supported_metadata(content, summary, name))


def named_model(metadata: Mapping[str, str]) -> str:
    """Hash of the model that lies apart, by the metadata of an episode; or nothing.

    Raises:
        KeyError, ValueError: it should say, and does not.
    """
    version = metadata["format_version"]
    if version == str(schema.TEAM_VERSION) and MODEL_KEY not in metadata:
        return ""
    if version not in (str(schema.APART_VERSION), str(schema.TEAM_VERSION)):
        return ""
    sha256 = metadata[MODEL_KEY]
    if not _SHA256.fullmatch(sha256):
        raise ValueError(f"{sha256[:80]!r} is no hash of a model")
    return sha256


def decode_features(content: bytes, name: str) -> np.ndarray:
    """The feature rows [T, F] in the bytes of a file, float32 and read-only.

    Raises:
        EpisodeError: as for `read_episode`.
    """
    with corrupt_if_unreadable(name):
        features = _open(content, name).rows("features")
        features.setflags(write=False)
        return features


@contextmanager
def corrupt_if_unreadable(name: str) -> Iterator[None]:
    """Whatever parsing foreign bytes raises is one thing to a caller."""
    try:
        yield
    except GaitprefError:
        raise
    except Exception as error:
        found = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise CorruptEpisode(
            f"{name} is damaged ({found}); restore it from a copy or record it again"
        ) from error


@dataclass(frozen=True, eq=False)
class _Parts:
    """What both readers need of a file; views into its bytes."""

    steps: list[np.ndarray]
    """[T] of `schema.STEP_RECORD` in all, chunk by chunk."""
    final: np.ndarray
    """[1] of `schema.FINAL_RECORD`."""
    metadata: dict[str, str]
    summary: list[McapRecord]

    def rows(self, field: str, *, with_final: bool = False) -> np.ndarray:
        """A field of all steps, [T, ...] or with the final state [T + 1, ...]."""
        arrays = [chunk["body"][field] for chunk in self.steps]
        return np.concatenate(
            [*arrays, self.final["body"][field]] if with_final else arrays
        )


def _open(content: bytes, name: str) -> _Parts:
    """Check the file and find its messages."""
    summary = checked_summary(content, name)
    step_channel, final_channel = supported_channels(summary, name)
    metadata = _supported_metadata(content, summary, name)
    records = {step_channel: schema.STEP_RECORD, final_channel: schema.FINAL_RECORD}
    steps: list[np.ndarray] = []
    finals: list[np.ndarray] = []
    for index in chunk_indexes(summary, name):
        start = index.chunk_start_offset
        stop = start + index.chunk_length + index.message_index_length
        found = chunk_messages(content[start:stop], index, records)
        steps.append(found[step_channel])
        if final_channel in found:
            finals.append(found[final_channel])
        require_size(sum(chunk.nbytes for chunk in steps), EPISODE_UNPACKED_BYTES)
    num_steps = sum(len(chunk) for chunk in steps)
    num_finals = sum(len(chunk) for chunk in finals)
    if num_finals != 1:
        raise ValueError(f"{num_finals} final states, an episode has 1")
    if metadata["n_steps"] != str(num_steps):
        raise ValueError(f"{num_steps} steps, promised {metadata['n_steps'][:20]}")
    parts = _Parts(steps, finals[0], metadata, summary)
    if not np.array_equal(parts.rows("step"), np.arange(num_steps)):
        raise ValueError("the steps are not numbered 0, 1, 2, ...")
    return parts


def chunk_indexes(summary: list[McapRecord], name: str) -> list[ChunkIndex]:
    """The chunks of an episode in the order of time.

    Raises:
        UnsupportedSchema: they are compressed in a way this version does not read.
        ValueError: there are none.
    """
    found = [record for record in summary if isinstance(record, ChunkIndex)]
    if not found:
        raise ValueError("no chunk of messages")
    for index in found:
        if index.compression not in get_args(Compression):
            raise UnsupportedSchema(
                f"{name} is compressed with {index.compression[:20]!r}, episodes are "
                "stored uncompressed or with zstd; use the file that `gaitpref record` "
                "wrote"
            )
    return sorted(found, key=lambda index: index.chunk_start_offset)


def supported_channels(summary: list[McapRecord], name: str) -> tuple[int, int]:
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
    readable = tuple(str(version) for version in schema.READABLE_VERSIONS)
    for key, expected in (
        ("format_version", readable),
        ("schema_sha256", (schema.schema_sha256(),)),
        ("features_sha256", (features_sha256(),)),
    ):
        if metadata[key] not in expected:
            found = " ".join(metadata[key][:64].split())
            raise UnsupportedSchema(
                f"{name} has {key} {found}, this version reads "
                f"{' and '.join(expected)}; read it with the version of gaitpref that "
                "wrote it"
            )
    return metadata


def _mjcf(
    content: bytes, parts: _Parts, name: str, model_of: Callable[[str], str] | None
) -> str:
    """The model of the robot, out of the file or from beside it."""
    sha256 = named_model(parts.metadata)
    if sha256:
        if model_of is None:
            raise CorruptEpisode(
                f"{name} goes without the model of its robot; read it in the data set "
                "that it lies in, or with `read_episode`"
            )
        return model_of(sha256)
    return _attached(content, parts, MJCF_NAME).decode()


def _mate(content: bytes, parts: _Parts, name: str, mjcf: str) -> Episode | None:
    """The other robot of a team, which has the same model `mjcf`."""
    if parts.metadata["format_version"] != str(schema.TEAM_VERSION):
        return None
    own = _attached(content, parts, MATE_NAME)
    inner = f"{MATE_NAME} of {name}"
    # No file holds a file that holds a file: the depth would be a stranger's choice.
    facts = _supported_metadata(own, checked_summary(own, inner), inner)
    if facts["format_version"] != str(schema.APART_VERSION):
        raise ValueError(f"{MATE_NAME} is no file of one robot without its model")
    return decode_episode(own, inner, lambda sha256: _same(mjcf, sha256))


def _same(mjcf: str, sha256: str) -> str:
    if model_sha256(mjcf) != sha256:
        raise ValueError(f"{MATE_NAME} is of a robot in another world")
    return mjcf


def _attached(content: bytes, parts: _Parts, wanted: str) -> bytes:
    """What is attached to the file under a name."""
    indexes = [r for r in parts.summary if isinstance(r, AttachmentIndex)]
    found = [index for index in indexes if index.name == wanted]
    if len(found) != 1 or len(indexes) != _attachments(parts.metadata):
        raise ValueError(f"{len(indexes)} attachments, of which {wanted} {len(found)}")
    offset = found[0].offset
    return Attachment.read(record_at(content, offset, Opcode.ATTACHMENT)).data


def _attachments(metadata: Mapping[str, str]) -> int:
    """How many a file has: the model, if it is not apart, and the mate of a team."""
    is_team = metadata["format_version"] == str(schema.TEAM_VERSION)
    return is_team + (not named_model(metadata))
