"""Gets every whole chunk out of an episode file that was cut short or damaged.

Shapes: T steps in a row that were saved.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from io import BytesIO
from typing import cast

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Metadata

from data.episodes import schema
from data.episodes.chunks import FINAL_CHANNEL, STEP_CHANNEL
from data.episodes.episode import named_model
from data.episodes.episode_records import END_REASONS, EndReason, Episode, EpisodeMeta
from data.episodes.mcap_records import chunk_content
from data.errors import CorruptEpisode
from data.features import features_sha256
from data.files.limits import EPISODE_UNPACKED_BYTES

from .manifest import EpisodeEntry

_MAGIC_BYTES = 8
_CHUNK_HEAD = struct.Struct("<BQQQQII")


@dataclass(frozen=True)
class Salvage:
    """What was saved of one file."""

    episodes: tuple[Episode, ...]
    """Runs of steps without a gap; one that is whole equals what was written."""
    promised_steps: int | None
    """Steps the file once had, if it still says so."""
    problem: str = ""
    """Why nothing could be saved, where steps were found or should have been."""
    models_apart: bool = False
    """Whether the file went without its model, and what was saved of it does."""

    @property
    def kept_steps(self) -> int:
        """Steps in all episodes."""
        return sum(episode.num_steps for episode in self.episodes)

    @property
    def lost_steps(self) -> int | None:
        """Promised steps that are gone."""
        if self.promised_steps is None:
            return None
        return self.promised_steps - self.kept_steps


def salvage(
    content: bytes,
    source: str,
    *,
    entry: EpisodeEntry | None = None,
    mjcf: str | None = None,
    model_of: Callable[[str], str] | None = None,
) -> Salvage:
    """Whatever can be proved to be as it was written, as episodes.

    A part that does not reach the end of the episode ends as `aborted`, and its final
    state, which nobody knows, is NaN.

    Args:
        content: All bytes that there are.
        source: Where they come from; noted in every part.
        entry: What a manifest says of the file, believed before the file itself.
        mjcf: The robot from elsewhere, used if the file's is lost.
        model_of: Gives the model of a robot by its hash, where files go without.
    """
    facts, found_mjcf, steps, final = _scan(content)
    promised = entry.num_steps if entry else _count(facts.get("n_steps"))
    of_team = facts.get("format_version") == str(schema.TEAM_VERSION)
    if of_team or (entry is not None and entry.meta.is_team):
        return Salvage(
            (), promised, "a part of it would be one robot without the other"
        )
    if not len(steps):
        return Salvage((), promised, "no whole chunk of steps is left")
    try:
        meta = entry.meta if entry else EpisodeMeta.from_strings(facts)
    except (KeyError, ValueError):
        return Salvage((), promised, "its metadata is lost")
    apart = entry.mjcf_sha256 if entry else _named_model(facts)
    if apart and model_of is not None:
        found_mjcf = _model(model_of, apart)
    mjcf = found_mjcf if found_mjcf is not None else mjcf
    if mjcf is None:
        return Salvage((), promised, "its robot model is lost")
    end_reason = entry.end_reason if entry else facts.get("end_reason")
    parts = list(_runs(steps))
    episodes: list[Episode] = []
    for part in parts:
        first = int(part["step"][0])
        last = first + len(part) == promised and final is not None
        whole = last and first == 0 and end_reason in END_REASONS
        extra = {
            "recovered_from": source,
            "recovered_first_step": str(first),
            "recovered_of_steps": str(promised or "unknown"),
        }
        episodes.append(
            _episode(
                part,
                final if last else None,
                cast(EndReason, end_reason) if whole else "aborted",
                meta if whole else replace(meta, extra=meta.extra | extra),
                mjcf,
            )
        )
    return Salvage(tuple(episodes), promised, models_apart=bool(apart))


def _named_model(facts: Mapping[str, str]) -> str:
    """Hash of the model that a file goes without, as far as it says."""
    try:
        return named_model(facts)
    except (KeyError, ValueError):
        return ""


def _model(model_of: Callable[[str], str], sha256: str) -> str | None:
    try:
        return model_of(sha256)
    except CorruptEpisode:
        return None


def _scan(
    content: bytes,
) -> tuple[Mapping[str, str], str | None, np.ndarray, np.ndarray | None]:
    """Metadata, robot model, steps sorted by number and the final state."""
    facts: dict[str, str] = {}
    mjcf: str | None = None
    steps: list[np.ndarray] = []
    final: np.ndarray | None = None
    room = EPISODE_UNPACKED_BYTES
    for opcode, start, end in _records(content):
        try:
            if opcode == Opcode.METADATA:
                facts = Metadata.read(_stream(content, start, end)).metadata
            elif opcode == Opcode.ATTACHMENT:
                mjcf = _attachment(content, start, end)
            elif opcode == Opcode.CHUNK:
                # What is claimed counts, also where it then does not fit.
                room -= _CHUNK_HEAD.unpack_from(content, start)[4]
                if room < 0:
                    break
                found, found_final = _chunk(content[start:end])
                steps.append(found)
                final = found_final if found_final is not None else final
        except Exception:
            # Foreign bytes fail in any way; what does not parse is not saved.
            continue
    if not _same_schema(facts) or not steps:
        return facts, mjcf, np.zeros(0, schema.body_dtype(schema.STEP_FIELDS)), None
    every = np.concatenate(steps)
    _, first_of = np.unique(every["step"], return_index=True)
    return facts, mjcf, every[first_of], final


def _same_schema(facts: Mapping[str, str]) -> bool:
    """Lost metadata says nothing; that of another version says no."""
    return facts.get("schema_sha256", schema.schema_sha256()) == (
        schema.schema_sha256()
    ) and facts.get("features_sha256", features_sha256()) == (features_sha256())


def _records(content: bytes) -> Iterator[tuple[int, int, int]]:
    """Opcode, first byte and end of every whole record, and of chunks behind damage."""
    position = _MAGIC_BYTES
    while position + 9 <= len(content):
        opcode, length = struct.unpack_from("<BQ", content, position)
        end = position + 9 + length
        known = Opcode.HEADER <= opcode <= Opcode.DATA_END
        if known and end <= len(content):
            yield opcode, position, end
            position = end
            continue
        # A record cut off, or a damaged length: a later chunk still shows itself.
        following = content.find(bytes((Opcode.CHUNK,)), position + 1)
        while following >= 0 and not _looks_like_chunk(content, following):
            following = content.find(bytes((Opcode.CHUNK,)), following + 1)
        if following < 0:
            return
        position = following


def _looks_like_chunk(content: bytes, position: int) -> bool:
    """A record head whose sizes agree with one another and with the file."""
    if position + _CHUNK_HEAD.size + 8 > len(content):
        return False
    _, length, start, end, size, _, name_size = _CHUNK_HEAD.unpack_from(
        content, position
    )
    if name_size > 4 or position + 9 + length > len(content) or start > end:
        return False
    stored = length - 40 - name_size
    (promised,) = struct.unpack_from(
        "<Q", content, position + _CHUNK_HEAD.size + name_size
    )
    return stored == promised and (name_size > 0 or stored == size)


def _stream(content: bytes, start: int, end: int) -> ReadDataStream:
    return ReadDataStream(BytesIO(content[start + 9 : end]))


def _attachment(content: bytes, start: int, end: int) -> str:
    (crc,) = struct.unpack_from("<I", content, end - 4)
    if zlib.crc32(content[start + 9 : end - 4]) != crc:
        raise ValueError("the checksum of the attachment is wrong")
    return Attachment.read(_stream(content, start, end)).data.decode()


def _chunk(block: bytes) -> tuple[np.ndarray, np.ndarray | None]:
    """Steps and final state in a chunk whose checksum is right."""
    content = chunk_content(block)
    position = 0
    while content[position] != Opcode.MESSAGE:
        position += 9 + struct.unpack_from("<Q", content, position + 1)[0]
    rest = len(content) - position
    num_steps, left_over = divmod(rest, schema.STEP_RECORD.itemsize)
    steps = np.frombuffer(content, schema.STEP_RECORD, num_steps, position)
    if left_over not in (0, schema.FINAL_RECORD.itemsize):
        raise ValueError("messages of another size")
    if not (steps["channel"] == STEP_CHANNEL).all():
        raise ValueError("messages of another channel")
    if not left_over:
        return steps["body"], None
    start = len(content) - left_over
    final = np.frombuffer(content, schema.FINAL_RECORD, 1, start)
    if final["channel"][0] != FINAL_CHANNEL:
        raise ValueError("the last message is no final state")
    return steps["body"], final["body"]


def _runs(steps: np.ndarray) -> list[np.ndarray]:
    """Split steps sorted by number where one is missing."""
    gaps = np.flatnonzero(np.diff(steps["step"].astype(np.int64)) != 1) + 1
    return np.split(steps, gaps)


def _count(text: str | None) -> int | None:
    return int(text) if text is not None and text.isdecimal() else None


def _episode(
    steps: np.ndarray,
    final: np.ndarray | None,
    end_reason: EndReason,
    meta: EpisodeMeta,
    mjcf: str,
) -> Episode:
    def states(name: str) -> np.ndarray:
        rows = steps[name]
        last = np.full_like(rows[:1], np.nan) if final is None else final[name]
        return np.concatenate([rows, last])

    return Episode(
        qpos=states("qpos"),
        qvel=states("qvel"),
        obs=states("obs"),
        action=np.array(steps["action"]),
        ctrl=np.array(steps["ctrl"]),
        features=np.array(steps["features"]),
        reward=np.array(steps["reward"]),
        end_reason=end_reason,
        meta=meta,
        mjcf=mjcf,
    )
