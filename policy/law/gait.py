"""The gait that a policy with a clock is asked for, the same all the time.

Parts of a cycle are told in turns; feet are FL FR RL RR. Shapes: N robots.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass

import torch
from torch import Tensor


@dataclass(frozen=True, kw_only=True)
class Gait:
    """What such a policy sees behind its command, in this order. The defaults trot."""

    body_height_m: float = 0.0
    """Above the height that is usual."""
    frequency_hz: float = 3.0
    """Cycles a second."""
    phase: float = 0.5
    """How far FL and RR are ahead."""
    offset: float = 0.0
    """How far FL and FR are ahead."""
    bound: float = 0.0
    """How far FL and RL are ahead."""
    duration: float = 0.5
    """Share of a cycle in which a foot stands."""
    footswing_height_m: float = 0.08
    """How high it swings."""
    pitch_rad: float = 0.0
    """Of the body."""
    roll_rad: float = 0.0
    """Of the body."""
    stance_width_m: float = 0.25
    """Between left and right feet."""
    stance_length_m: float = 0.4
    """Between front and rear feet."""
    auxiliary: float = 0.0
    """Weight of the rewards beside, where a training varies it."""

    @property
    def fault(self) -> str | None:
        """What cannot be followed of it, in words."""
        if not all(map(math.isfinite, self.values)):
            return "has a number that is not finite"
        if not 0 < self.frequency_hz <= 20 or not 0 < self.duration < 1:
            return (
                "needs frequency_hz in (0, 20] and duration in (0, 1), got "
                f"{self.frequency_hz} and {self.duration}"
            )
        return None

    @property
    def values(self) -> tuple[float, ...]:
        """Its twelve numbers."""
        return astuple(self)


def clock(gait: Gait, time_s: Tensor) -> Tensor:
    """[N, 4] where each foot is in its cycle, as a sine that is above 0 while it
    stands.

    Args:
        gait: What is asked for.
        time_s: [N] since the episode began, which is the start of a cycle.
    """
    ahead = [gait.phase + gait.offset + gait.bound, gait.offset, gait.bound, gait.phase]
    starts = torch.tensor(ahead, dtype=time_s.dtype, device=time_s.device)
    turns = (time_s[:, None] * gait.frequency_hz + starts).remainder(1.0)
    stands = gait.duration
    # Standing takes half of the sine, however long it is.
    warped = torch.where(
        turns < stands,
        0.5 * turns / stands,
        0.5 + 0.5 * (turns - stands) / (1.0 - stands),
    )
    return torch.sin(2 * math.pi * warped)
