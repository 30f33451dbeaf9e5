"""What was recorded, whether somebody judged it or not: what an opinion is about.

Few answers are about few clips, which do not tell how far apart gaits are, or what of a
habit there is to see. Shapes: C clips, T steps, F features.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from data.datasets.dataset import Dataset, EpisodeEntry
from data.episodes.clips import Clip, cut_clips

from .clip_batch import ClipBatch, fill_clips, with_past

_CLIP_S = 1.2
_EPISODES = 256
"""Looked at, at most."""
_CLIPS_OF_EACH = 2


@dataclass(frozen=True, eq=False)
class RecordedClips:
    """Clips of what was recorded."""

    clips: ClipBatch
    """[C, T, F]."""
    command: Tensor
    """[C] int64, equal where the robot was told the same."""


def recorded_clips(datasets: Sequence[Dataset]) -> RecordedClips | None:
    """Some clips of the episodes of `datasets`, whatever their order; None where no
    episode is long enough.

    Raises:
        DatasetError, EpisodeError: an episode is missing or damaged.
    """
    chosen = [
        (dataset, entry)
        for dataset in datasets
        for entry in dataset.entries()
        if _clips_of(entry)
    ]
    chosen.sort(key=lambda each: each[1].sha256)
    told: dict[object, int] = {}
    clips: list[Clip] = []
    rows, commands = [], []
    for dataset, entry in chosen[:_EPISODES]:
        own = _clips_of(entry)
        some = own[:: max(1, len(own) // _CLIPS_OF_EACH)][:_CLIPS_OF_EACH]
        meta = entry.meta
        for clip in some:
            changes = meta.command_change_steps
            what = (meta.command, changes, clip.start if changes else 0)
            commands.append(told.setdefault(what, len(told)))
        for index, features in dataset.each_clip_features([with_past(c) for c in some]):
            rows.append((len(clips) + index, features))
        clips += some
    if not clips:
        return None
    batch = fill_clips([clip.steps for clip in clips], rows)
    return RecordedClips(batch, torch.tensor(commands))


def _clips_of(entry: EpisodeEntry) -> list[Clip]:
    steps = max(1, round(_CLIP_S / entry.meta.control_dt_s))
    return [
        clip
        for clip in cut_clips([entry], steps=steps, stride=steps, min_steps=steps)
        if clip.stop < entry.num_steps or entry.end_reason == "truncated"
    ]
