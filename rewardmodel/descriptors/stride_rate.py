"""Strides a second, from the lift-offs of all feet.

Shapes: T steps, D descriptors, L steps before a clip.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from rewardmodel.answers.clip_batch import PAST_STEPS, since_start

from .row import Habit
from .table import names_seen

STRIDE_RATE = Habit(
    "stride_rate",
    "Hz",
    "strides a second, over the last second",
    aspect="rhythm",
    concept="rate of steps",
)
"""The habit that no single row tells."""
_CONTACTS = tuple(
    index
    for index, name in enumerate(names_seen("legs"))
    if name.startswith("contact_")
)
_LEAST_STEPS = 20
"""The fewest steps a count of lift-offs is divided by: early in an episode one is no
rate."""


def stride_rate(
    steps: Tensor,
    starts: Tensor | None = None,
    *,
    scored: Tensor | None = None,
    before: Tensor | None = None,
) -> Tensor:
    """[..., T] strides per step of standardised `steps` [..., T, D], over the last
    second of the episode at hand: lift-offs of all feet, by four.

    Args:
        steps: Sequences.
        starts: [..., T] bool, first steps of episodes; None for clips, which begin in
            the middle of a walk.
        scored: [..., T] bool, steps of the clips that count, padding behind them;
            None where all do.
        before: [..., L] lift-offs before the clips, as of `ClipBatch`; None where
            nobody knows them.
    """
    down = steps[..., list(_CONTACTS)]
    # However standardised, a contact takes two values, some deviations apart.
    lifted = (down[..., :-1, :] - down[..., 1:, :] > 0.5).float().sum(dim=-1)
    if before is not None:
        begun = before.isfinite()
        lifted = torch.cat([torch.where(begun, before, 0.0), lifted], dim=-1)
        first = torch.zeros_like(lifted, dtype=torch.bool)
        first[..., : begun.shape[-1]] = begun & (begun.cumsum(dim=-1) == 1)
        return _over_the_last_second(lifted, first)[..., begun.shape[-1] - 1 :]
    lifted = functional.pad(lifted, (1, 0))
    if starts is not None:
        return _over_the_last_second(lifted.masked_fill(starts, 0.0), starts)
    rate = _over_the_last_second(lifted, None)
    if rate.shape[-1] >= PAST_STEPS:
        # Its first whole second tells the rate of all before it; few steps would not.
        last = PAST_STEPS - 1
        early, whole = rate[..., :last], rate[..., last, None]
        if scored is not None:
            whole = torch.where(scored[..., last, None], whole, early)
        rate[..., :last] = whole
    return rate


def _over_the_last_second(lifted: Tensor, starts: Tensor | None) -> Tensor:
    """[..., T] strides per step of lift-offs [..., T], of which none is looked at that
    lies before the newest of `starts` [..., T]."""
    counted = functional.pad(lifted.cumsum(dim=-1), (1, 0))
    time = torch.arange(lifted.shape[-1], device=lifted.device)
    first = (time - PAST_STEPS + 1).clamp_min(0).expand(lifted.shape)
    if starts is not None:
        first = torch.maximum(first, since_start(starts))
    strides = (counted[..., 1:] - counted.gather(-1, first)) / 4
    return strides / (time - first + 1).clamp_min(_LEAST_STEPS)
