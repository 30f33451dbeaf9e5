"""Clips: stretches of episodes, short enough to be judged at a glance."""

from __future__ import annotations

import operator
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

from .episode_records import EndReason


@dataclass(frozen=True, order=True, slots=True)
class Clip:
    """A stretch of one episode; describes itself, so it outlives any data base.

    Raises:
        ValueError: there can be no such clip.
    """

    rollout: str
    """SHA-256 of the episode file."""
    start: int
    """First control step."""
    steps: int
    """Number of control steps."""

    def __post_init__(self) -> None:
        # An index out of an array becomes a plain one, which SQLite and JSON can hold.
        if type(self.start) is not int or type(self.steps) is not int:
            for name in ("start", "steps"):
                object.__setattr__(self, name, operator.index(getattr(self, name)))
        if not self.rollout or self.start < 0 or self.steps < 1:
            raise ValueError(
                "a clip needs the sha256 of its episode, start >= 0 and steps >= 1, "
                f"got {self.rollout!r}, {self.start}, {self.steps}"
            )

    @property
    def stop(self) -> int:
        """The first control step behind the clip."""
        return self.start + self.steps

    @property
    def rows(self) -> slice:
        """The clip's rows of the episode's per-step arrays."""
        return slice(self.start, self.stop)

    @property
    def key(self) -> str:
        """Text that is the same for the same clip, everywhere and always."""
        return f"{self.rollout}:{self.start}+{self.steps}"


class ClipSource(Protocol):
    """The facts of an episode that cutting needs; `EpisodeEntry` has them."""

    @property
    def sha256(self) -> str: ...
    @property
    def num_steps(self) -> int: ...
    @property
    def end_reason(self) -> EndReason: ...


def cut_clips(
    entries: Iterable[ClipSource], *, steps: int, stride: int, min_steps: int
) -> list[Clip]:
    """Cut episodes into clips that start every `stride` steps.

    An episode file holds one episode, so no clip crosses a reset. After a fall one more
    clip ends exactly at the fall: it starts where the next clip would, and keeps its
    true length of at least `min_steps`; would it be shorter, it is moved back to the
    full length instead. Aborted episodes give no clip.

    Args:
        entries: Episodes; the clips keep their order.
        steps: Length of a clip in control steps.
        stride: Control steps from one start to the next.
        min_steps: Shortest clip that can be judged, at most `steps`.

    Raises:
        ValueError: the lengths contradict each other.
    """
    if not (0 < min_steps <= steps and stride > 0):
        raise ValueError(
            "clips need 0 < min_steps <= steps and stride > 0, "
            f"got min_steps={min_steps}, steps={steps}, stride={stride}"
        )
    return [
        Clip(entry.sha256, start, length)
        for entry in entries
        if entry.end_reason != "aborted"
        for start, length in _cuts(
            entry.num_steps, entry.end_reason == "terminated", steps, stride, min_steps
        )
    ]


def _cuts(
    num_steps: int, fell: bool, steps: int, stride: int, min_steps: int
) -> list[tuple[int, int]]:
    """Start and length of the clips of one episode."""
    cuts = [(start, steps) for start in range(0, num_steps - steps + 1, stride)]
    if fell and (not cuts or sum(cuts[-1]) < num_steps):
        start = len(cuts) * stride
        if num_steps - start >= min_steps:
            cuts.append((start, num_steps - start))
        elif num_steps >= steps:
            cuts.append((num_steps - steps, steps))
    return cuts
