"""Pairs in step: both clips begin where the same foot comes down.

Two gaits are easier to compare when the eye need not wait for one of them; a clip moves
by less than half a stride of the cut, so that it is still the stretch that was chosen.

Shapes: T steps, L legs.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from data.answers.answer_records import Pair
from data.datasets.dataset import EpisodeEntry
from data.episodes.clips import Clip
from data.features import column
from rewardmodel.answers.clip_batch import ClipRows

LEAD_LEG = 0
"""The foot that begins: the first of `data.features.LEGS`."""


def in_step(
    pair: Pair,
    entries: dict[str, EpisodeEntry],
    clip_rows: ClipRows,
    *,
    reach_s: float,
) -> Pair:
    """The pair with its clips moved by at most `reach_s`, each to a touchdown.

    Both stay where they are if either does not walk there (a foot that comes down at
    least twice walks), ends in a fall, which must be seen, or was told something else
    underway, when equal starts are what makes them comparable.

    Args:
        pair: Two clips.
        entries: The episodes of the clips, by SHA-256.
        clip_rows: Gives feature rows.
        reach_s: How far a clip may move.
    """
    moved = []
    for clip in (pair.a, pair.b):
        entry = entries[clip.rollout]
        fell = entry.end_reason == "terminated" and clip.stop >= entry.num_steps
        if fell or entry.meta.command_change_steps:
            return pair
        reach = int(reach_s / entry.meta.control_dt_s)
        start = _touchdown_near(clip, entry.num_steps, clip_rows, reach)
        if start is None:
            return pair
        moved.append(replace(clip, start=start))
    first, second = sorted(moved)
    if first.rollout == second.rollout and first.stop > second.start:
        # Stretches of one episode, which showed different steps before.
        return pair
    return Pair.make(*moved, strategy=pair.strategy, round=pair.round, info=pair.info)


def touchdowns(contact: np.ndarray) -> np.ndarray:
    """Steps at which a foot comes down, given its contact [T] as 0 or 1."""
    down = contact > 0.5
    return np.flatnonzero(down[1:] & ~down[:-1]) + 1


def overlapping(clip: Clip, others: Iterable[Clip]) -> list[Clip]:
    """The clips of `others` that show mostly the same as `clip`: more than half of the
    longer of the two is common to both."""
    return [
        other
        for other in others
        if other.rollout == clip.rollout
        and 2 * (min(clip.stop, other.stop) - max(clip.start, other.start))
        > max(clip.steps, other.steps)
    ]


def _touchdown_near(
    clip: Clip, num_steps: int, clip_rows: ClipRows, reach: int
) -> int | None:
    """First step of the touchdown nearest to the clip's start; None if there is none
    it can begin with, or the robot does not walk."""
    first = max(0, clip.start - reach)
    last = min(num_steps, clip.stop + reach)
    rows = clip_rows(Clip(clip.rollout, first, last - first))
    contact = rows[:, column("foot_contact")][:, LEAD_LEG]
    found = touchdowns(contact) + first
    if len(found) < 2:
        return None
    starts = found[
        (abs(found - clip.start) <= reach) & (found + clip.steps <= num_steps)
    ]
    if not len(starts):
        return None
    return int(starts[abs(starts - clip.start).argmin()])
