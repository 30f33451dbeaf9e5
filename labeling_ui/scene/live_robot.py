"""Robots that are simulated while somebody watches.

Shapes: T steps of the last seconds.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .geometry import RobotGeometry, instance_poses
from .scene import Pose

HISTORY_S = 3.0
"""How far back the footfalls go, and what is judged."""
_FOLLOW_S = 0.4
"""The camera follows the base with this delay, so that its surging stays visible."""
_FALLEN_S = 1.0
"""How long a robot that fell lies there before it starts anew."""


@dataclass(frozen=True, kw_only=True)
class Drive:
    """What the visitor asks of every robot in the next control step."""

    command: tuple[float, float, float]
    """Forward m/s, left m/s, yaw rad/s."""
    push_m_s: tuple[float, float] = (0.0, 0.0)
    """Speed a push adds to the base, world frame."""
    reset: bool = False
    """Start anew."""


@dataclass(frozen=True, eq=False)
class LiveState:
    """What a control step led to, before any reset."""

    qpos: np.ndarray
    """[nq]"""
    contact: np.ndarray
    """[4] feet on the ground."""
    speed_m_s: float
    """Forward."""
    height_m: float
    fallen: bool


StepFn = Callable[[Drive], LiveState]
"""Runs one control step."""


@dataclass(frozen=True, eq=False)
class LivePolicy:
    """A policy to watch."""

    name: str
    geometry: RobotGeometry
    control_dt_s: float
    new_step: Callable[[], StepFn]
    """A simulation of its own for every visitor."""


class LiveRobot:
    """One simulated robot of one visitor."""

    def __init__(self, policy: LivePolicy) -> None:
        self.policy = policy
        self.step_fn = policy.new_step()
        rows = round(HISTORY_S / policy.control_dt_s)
        self._contacts: deque[np.ndarray] = deque(maxlen=rows)
        self._path: np.ndarray | None = None
        self._lying_s = 0.0
        self.falls = 0
        self.state: LiveState | None = None

    @property
    def contacts(self) -> np.ndarray:
        """[T, 4] of the last seconds."""
        return np.array(self._contacts, dtype=bool).reshape(-1, 4)

    def step(self, drive: Drive) -> None:
        """One control step; a robot that fell lies for a moment first."""
        dt_s = self.policy.control_dt_s
        if self._lying_s > 0 and not drive.reset:
            self._lying_s -= dt_s
            return
        self._lying_s = 0.0
        self.state = state = self.step_fn(drive)
        self._contacts.append(np.asarray(state.contact) > 0)
        floor_m = self.policy.geometry.floor_m(state.qpos[:2])
        here = np.array([*state.qpos[:2], floor_m])
        if self._path is None or np.linalg.norm(here - self._path) > 1.0:
            self._path = here
        self._path = self._path + (here - self._path) * min(dt_s / _FOLLOW_S, 1.0)
        if state.fallen:
            self.falls += 1
            self._lying_s = _FALLEN_S

    def pose(self) -> Pose | None:
        """How it stands now; None before the first step."""
        if self.state is None or self._path is None:
            return None
        positions, wxyzs = instance_poses(self.policy.geometry, self.state.qpos[None])
        *ground, floor_m = self._path.astype(np.float32)
        positions[0, :, 2] -= floor_m
        return Pose(positions[0], wxyzs[0], np.array(ground), self._lying_s > 0)
