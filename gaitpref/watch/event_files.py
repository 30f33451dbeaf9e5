"""Scalars of a training that goes on, read from its TensorBoard files as they grow."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tensorboard.backend.event_processing.event_file_loader import EventFileLoader
from tensorboard.util.tensor_util import make_ndarray

RETURN, TRACKING, PLANNED = "train/return", "track/planar_error_m_s", "plan/steps"
LAG = "actors/lag_mean"
_TAGS = (RETURN, TRACKING, PLANNED, LAG)
_MOST_FILES = 100


@dataclass
class Scalars:
    """Points of some tags of one training directory, each (step, value, wall time)."""

    directory: Path
    points: dict[str, list[tuple[int, float, float]]] = field(
        default_factory=lambda: {tag: [] for tag in _TAGS}
    )
    _loaders: dict[Path, Any] = field(default_factory=dict)

    def read_on(self) -> None:
        """Take what was written since the last time."""
        for path in sorted(self.directory.glob("events.out.tfevents.*"))[-_MOST_FILES:]:
            try:
                if path not in self._loaders:
                    self._loaders[path] = EventFileLoader(str(path))
                self._take(self._loaders[path])
            # What is no event file, or was damaged, ends in one of many ways.
            except Exception:
                continue

    def _take(self, loader: EventFileLoader) -> None:
        for event in loader.Load():
            for value in event.summary.value:
                if value.tag in _TAGS:
                    number = float(make_ndarray(value.tensor).item())
                    self._add(value.tag, (event.step, number, event.wall_time))

    def _add(self, tag: str, point: tuple[int, float, float]) -> None:
        points = self.points[tag]
        # A training that was killed goes on from its last saved state, further back.
        while points and points[-1][0] >= point[0]:
            points.pop()
        points.append(point)

    @property
    def steps(self) -> int:
        """Environment steps so far."""
        return self.points[RETURN][-1][0] if self.points[RETURN] else 0

    @property
    def planned(self) -> int | None:
        """Environment steps it is to have; None where its files do not say."""
        found = self.points[PLANNED]
        return int(found[-1][1]) if found else None

    @property
    def steps_per_s(self) -> float | None:
        """Of the last iterations; None before two of them."""
        last = self.points[RETURN][-20:]
        if len(last) < 2 or last[-1][2] <= last[0][2]:
            return None
        return (last[-1][0] - last[0][0]) / (last[-1][2] - last[0][2])
