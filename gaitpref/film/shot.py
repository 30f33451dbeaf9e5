"""What a film shows: the states of one robot, evenly spaced in time.

Shapes: S states, nq positions of the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data.episodes.choices import choices_of
from data.episodes.clips import Clip
from data.episodes.episode_records import Episode


@dataclass(frozen=True, kw_only=True)
class Shot:
    """One robot's motion and what is written over it.

    Raises:
        ValueError: there is nothing to show, or no time between two states.
    """

    mjcf: str
    """The robot and its world as one self-contained MJCF text."""
    qpos: np.ndarray
    """[S, nq] positions of the model."""
    dt_s: float
    """Time from one state to the next."""
    caption: str = ""
    gaits: tuple[tuple[str, int, int], ...] = ()
    """Name, first state and state behind the last of each gait that a policy chose;
    empty where it has one."""

    def __post_init__(self) -> None:
        if self.qpos.ndim != 2 or not len(self.qpos):
            raise ValueError(f"qpos must be [S, nq] with S > 0, got {self.qpos.shape}")
        if not self.dt_s > 0:
            raise ValueError(f"dt_s must be above 0, got {self.dt_s}")

    @property
    def duration_s(self) -> float:
        """Time that the states stand for, the last one's included."""
        return len(self.qpos) * self.dt_s

    def states_at(self, fps: float, frames: int) -> np.ndarray:
        """[frames, nq] states nearest to the times of the frames; the last one stays
        where the motion is over."""
        return self.qpos[self._numbers(fps, frames)]

    def captions(self, fps: float, frames: int) -> list[str]:
        """What is written over each frame: the caption, and the gait that runs."""
        return [
            f"{self.caption}  {name}".strip() if name else self.caption
            for name in map(self._gait, self._numbers(fps, frames).tolist())
        ]

    def _gait(self, state: int) -> str:
        return next((name for name, a, b in self.gaits if a <= state < b), "")

    def _numbers(self, fps: float, frames: int) -> np.ndarray:
        """[frames] which state each frame shows."""
        numbers = np.round(np.arange(frames) / (fps * self.dt_s)).astype(int)
        return np.minimum(numbers, len(self.qpos) - 1)


def shot_of(episode: Episode, clip: Clip | None = None, *, caption: str = "") -> Shot:
    """A clip of an episode, or the whole of it."""
    rows = clip.rows if clip else slice(0, episode.num_steps)
    said = choices_of(episode.meta.extra, episode.num_steps)
    return Shot(
        mjcf=episode.mjcf,
        qpos=episode.world_qpos[rows],
        dt_s=episode.meta.control_dt_s,
        caption=caption,
        gaits=() if said is None else tuple(said.runs(rows)),
    )
