"""Clips as padded tensors, and the mean over the steps that count.

The return of a clip is the *mean* over its steps, not the sum: clips of unequal length
are then comparable, and a long clip is not better for being long. The row of a fall is
left out, because the fall itself has a fixed price.

A policy is paid for its rate of steps over the last second, and the second before a
short clip is most of that. So the lift-offs before a clip go with it.

Shapes: B clips, T steps of the longest, L steps looked back, F features, M ensemble
members.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import InitVar, dataclass, replace

import numpy as np
import torch
from torch import Tensor

from data.episodes.clips import Clip
from data.features import FEATURE_DIM, column, columns

from .spool import Spool, zeros

ClipRows = Callable[[Clip], np.ndarray]
"""Gives the feature rows [steps, F] of a clip; `Dataset.clip_features` is one."""

PART = 2048
"""Clips that something is made of at a time: it may take more memory than they do."""
PAST_STEPS = 50
"""Steps looked back over: 1 s at 50 Hz."""
_FALLEN = column("fallen").start
_CONTACT = column("foot_contact")


@dataclass(frozen=True, eq=False)
class ClipBatch:
    """Feature rows of clips, padded with zeros behind the last step of each.

    A feature that was not measured, as on hardware, is NaN in all steps of its clip.
    """

    features: Tensor
    """[B, T, F] float32."""
    valid: Tensor
    """[B, T] bool: steps that the clip has."""
    lift_offs_before: Tensor | None = None
    """[B, L] feet that left the ground at each of the steps up to the clip's first,
    that one included; NaN where the episode had not begun. None where nobody knows what
    came before."""
    spool: Spool | None = None
    """The file that holds the rows of very many clips."""
    checked: InitVar[bool] = False
    """Whether the rows are of a batch that was looked at already."""

    def __post_init__(self, checked: bool) -> None:
        if checked:
            return
        if self.features.ndim != 3 or self.features.shape[-1] != FEATURE_DIM:
            raise ValueError(
                f"clips must be [B, T, {FEATURE_DIM}], got {list(self.features.shape)}"
            )
        if self.valid.shape != self.features.shape[:2]:
            raise ValueError(
                f"valid must be {list(self.features.shape[:2])}, "
                f"got {list(self.valid.shape)}"
            )
        before = self.lift_offs_before
        if before is not None and before.shape != (len(self.valid), PAST_STEPS):
            raise ValueError(
                f"lift_offs_before must be {[len(self.valid), PAST_STEPS]}, "
                f"got {list(before.shape)}"
            )
        for _, part in self.parts():
            # Without a mask as large as the features; NaN is passed on by both.
            if not all(torch.isfinite(v) for v in part.features.aminmax()):
                _require_missing_as_a_whole(part.features, part.valid)

    def __len__(self) -> int:
        return len(self.features)

    def part(self, rows: slice | list[int]) -> ClipBatch:
        """Some of the clips, padded as before."""
        before, spool = self.lift_offs_before, self.spool
        features = self.features[rows]
        if spool is not None and not isinstance(rows, slice):
            # These are a copy.
            spool.release()
            spool = None
        return ClipBatch(
            features,
            self.valid[rows],
            None if before is None else before[rows],
            spool,
            checked=True,
        )

    def parts(self) -> Iterator[tuple[slice, ClipBatch]]:
        """All clips, some at a time, and which these are."""
        for first in range(0, len(self), PART):
            rows = slice(first, first + PART)
            part = self.part(rows)
            yield rows, part
            if self.spool is not None:
                self.spool.used(part.features.nbytes)

    def joined(self, others: ClipBatch) -> ClipBatch:
        """These, and `others`, padded to the same length, behind them."""
        before = None
        if self.lift_offs_before is not None and others.lift_offs_before is not None:
            before = torch.cat([self.lift_offs_before, others.lift_offs_before])
        return ClipBatch(
            torch.cat([self.features, others.features]),
            torch.cat([self.valid, others.valid]),
            before,
            checked=True,
        )

    @property
    def fallen(self) -> Tensor:
        """[B, T] bool: steps at which the robot fell."""
        return self.valid & (self.features[..., _FALLEN] > 0.5)

    @property
    def fell(self) -> Tensor:
        """[B] bool: clips that end in a fall."""
        return self.fallen.any(dim=-1)

    @property
    def scored(self) -> Tensor:
        """[B, T] bool: steps whose mean is the clip's return."""
        return self.valid & ~self.fallen


def _require_missing_as_a_whole(features: Tensor, valid: Tensor) -> None:
    """Let NaN pass where a whole feature is missing in a whole clip, and only there.

    Raises:
        ValueError: something is not finite for another reason.
    """
    known = ~features.isinf().any()
    for part in columns().values():
        nan = features[..., part].isnan()
        somewhere = (nan.any(dim=-1) & valid).any(dim=1)
        everywhere = (nan.all(dim=-1) | ~valid).all(dim=1)
        known = known & (~somewhere | everywhere).all()
    if not known:
        raise ValueError("a clip holds feature rows that are not finite")


def pad_clips(rows: Sequence[np.ndarray]) -> ClipBatch:
    """Clips given as feature rows [steps, F] each, padded to the longest; nobody knows
    what came before.

    Raises:
        ValueError: there is no clip, or one is empty or not finite.
    """
    filled = fill_clips([len(clip) for clip in rows], enumerate(rows))
    return replace(filled, lift_offs_before=None, checked=True)


def read_clips(clips: Sequence[Clip], clip_rows: ClipRows) -> ClipBatch:
    """`clips`, padded to the longest, and what came before each.

    Raises:
        ValueError: there is no clip, or one is not finite.
    """
    rows = (clip_rows(with_past(clip)) for clip in clips)
    return fill_clips([clip.steps for clip in clips], enumerate(rows))


def with_past(clip: Clip) -> Clip:
    """A clip with the steps before it that `fill_clips` looks at."""
    past = min(clip.start, PAST_STEPS)
    return Clip(clip.rollout, clip.start - past, clip.steps + past)


def fill_clips(
    steps: Sequence[int], rows: Iterable[tuple[int, np.ndarray]]
) -> ClipBatch:
    """Clips that come one by one in any order, padded to the longest.

    Args:
        steps: Number of steps of each clip.
        rows: Position of a clip in `steps` and its feature rows [steps, F], behind
            those of the steps before it, `PAST_STEPS` or as many as there are.

    Raises:
        ValueError: there is no clip, or one is empty or not finite.
    """
    if not steps or min(steps) == 0:
        raise ValueError("a batch needs at least one clip, and each clip a step")
    # Filled in place: the rows of many clips would not fit into memory twice.
    features, spool = zeros((len(steps), max(steps), FEATURE_DIM))
    before = np.full((len(steps), PAST_STEPS), np.nan, dtype=np.float32)
    finite = True
    for position, clip in rows:
        past = len(clip) - steps[position]
        own = features[position, : steps[position]]
        own[:] = clip[past:]
        before[position] = _lift_offs(clip[: past + 1])
        # While it is in the cache: looking at all clips once more takes longer.
        finite &= math.isfinite(np.vdot(own, own))
        if spool is not None:
            spool.used(own.nbytes)
    lengths = torch.tensor(steps)
    valid = torch.arange(features.shape[1]) < lengths[:, None]
    return ClipBatch(
        torch.from_numpy(features),
        valid,
        torch.from_numpy(before),
        spool,
        checked=finite,
    )


def _lift_offs(rows: np.ndarray) -> np.ndarray:
    """[L] feet that left the ground at each of the last steps of `rows` [K, F], NaN
    where there is none; at the first step of an episode none did."""
    down = rows[-PAST_STEPS - 1 :, _CONTACT] > 0.5
    lifted = (down[:-1] & ~down[1:]).sum(axis=1)
    if len(down) <= PAST_STEPS:
        lifted = np.concatenate([[0], lifted])
    found = np.full(PAST_STEPS, np.nan, dtype=np.float32)
    found[PAST_STEPS - len(lifted) :] = lifted
    return found


def mean_over(values: Tensor, counted: Tensor) -> Tensor:
    """Mean of `values` [..., T] over the steps in `counted` [..., T] (bool).

    A clip with no step that counts, as one that falls at once, has mean 0: that of an
    average clip, because rewards and descriptors are centred.
    """
    weights = counted.to(values.dtype)
    return (values * weights).sum(dim=-1) / weights.sum(dim=-1).clamp_min(1)


def since_start(starts: Tensor) -> Tensor:
    """[..., T] index of the newest start at or before each step of `starts` [..., T].

    Steps before the first start belong to a sequence that began earlier; the first of
    them stands for what is not seen.
    """
    index = torch.arange(starts.shape[-1], device=starts.device)
    return (starts * index).cummax(dim=-1).values
