"""Reads a few steps of an episode without the rest of its file.

The end of the file is compared with the hash in the manifest, and every chunk with its
own checksum: what is returned is what was written, or there is an error.

Shapes: T steps of the window, F columns of the feature row.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from mcap.records import ChunkIndex

from data.episodes import schema
from data.episodes.clips import Clip
from data.episodes.episode import (
    chunk_indexes,
    corrupt_if_unreadable,
    supported_channels,
)
from data.episodes.mcap_records import chunk_messages, summary_records, tail_start
from data.errors import CorruptEpisode
from data.files.files import open_regular, sha256_bytes
from data.files.limits import EPISODE_BYTES
from data.files.unpacking import require_size

from .manifest import EpisodeEntry

_TAIL_BYTES = 16 * 1024
"""Holds the end of an episode of up to a minute; of a longer one a second read."""


def read_feature_window(path: Path, entry: EpisodeEntry, clip: Clip) -> np.ndarray:
    """The feature rows [T, F] of a clip that lies within the episode.

    Raises:
        OSError: the file cannot be read.
        EpisodeError: the file is not the one the manifest means, or is damaged.
    """
    name = str(path)
    with open_regular(path) as file, corrupt_if_unreadable(name):
        descriptor = file.fileno()
        size = os.fstat(descriptor).st_size
        if size != entry.bytes:
            raise CorruptEpisode(
                f"{path} has {size} bytes, the manifest promises {entry.bytes}; "
                "restore it from a copy of the data set"
            )
        require_size(size, EPISODE_BYTES)
        tail = _tail(descriptor, size, name)
        if sha256_bytes(tail) != entry.tail_sha256:
            raise CorruptEpisode(
                f"{path} is not the file the manifest promises, its end differs; "
                "restore it from a copy of the data set"
            )
        summary = summary_records(tail[13:])
        channel, _ = supported_channels(summary, name)
        step_ns = round(entry.meta.control_dt_s * 1e9)
        rows = [
            _chunk_rows(descriptor, index, channel, clip)
            for index in chunk_indexes(summary, name)
            if index.message_start_time < clip.stop * step_ns
            and index.message_end_time >= clip.start * step_ns
        ]
        features = np.concatenate(rows)
        if len(features) != clip.steps:
            raise ValueError(f"{len(features)} steps instead of {clip.steps}")
        features.setflags(write=False)
        return features


def _tail(descriptor: int, size: int, name: str) -> bytes:
    """The checksum of the data, the summary and the footer."""
    end = os.pread(descriptor, _TAIL_BYTES, max(0, size - _TAIL_BYTES))
    start = tail_start(end, size, name)
    if start < size - len(end):
        return os.pread(descriptor, size - start, start)
    return end[start - (size - len(end)) :]


def _chunk_rows(
    descriptor: int, index: ChunkIndex, channel: int, clip: Clip
) -> np.ndarray:
    """The feature rows of the clip that are in one chunk."""
    length = index.chunk_length + index.message_index_length
    block = os.pread(descriptor, length, index.chunk_start_offset)
    steps = chunk_messages(block, index, {channel: schema.STEP_RECORD})[channel]["body"]
    number = steps["step"]
    first, stop = np.searchsorted(number, (clip.start, clip.stop))
    return steps["features"][first:stop]
