"""Whether a robot does what it was told: the way ahead of it, and how far it came.

Shapes: S states of a clip, T steps (S - 1), W marks of a way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MARKS = 5
"""W, the marks of the way that lies ahead."""
AHEAD_S = 0.5
"""How far ahead the way is drawn, at the speed that was asked for."""
_FROM_BASE_M = 0.27
_STILL = 0.02
"""m/s or rad/s; less is no motion."""
HIDDEN_M = -50.0
"""Height of marks that nobody is to see."""


@dataclass(frozen=True)
class Obeyed:
    """What a clip was to do, and what it did."""

    went_m: float
    """Way of the base in the direction that was asked for at each moment."""
    asked_m: float
    turned_rad: float
    asked_rad: float


def obeyed(
    ground: np.ndarray, heading_rad: np.ndarray, asked: np.ndarray, dt_s: float
) -> Obeyed:
    """Sum up a clip.

    Args:
        ground: [S, 2] m, base over ground.
        heading_rad: [S] without jumps.
        asked: [T, 3] forward m/s, left m/s, yaw rad/s, in the frame of the base.
        dt_s: Time between two states.
    """
    speed = np.hypot(asked[:, 0], asked[:, 1])
    moves = speed > _STILL
    angle = heading_rad[:-1] + np.arctan2(asked[:, 1], asked[:, 0])
    along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    steps = np.einsum("td,td->t", np.diff(ground, axis=0), along)
    return Obeyed(
        went_m=float(steps[moves].sum()),
        asked_m=float(speed[moves].sum() * dt_s),
        turned_rad=float(heading_rad[-1] - heading_rad[0]),
        asked_rad=float(asked[:, 2].sum() * dt_s),
    )


def ways(
    path: np.ndarray, heading_rad: np.ndarray, asked: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The way that lies ahead at each state: marks [S, W, 3] m and wxyz [S, W, 4].

    Args:
        path: [S, 2] m, where the robot is.
        heading_rad: [S]
        asked: [T, 3] as for `obeyed`; at the end the last command holds.
    """
    positions = np.full((len(path), MARKS, 3), HIDDEN_M)
    wxyzs = np.zeros((len(path), MARKS, 4))
    wxyzs[..., 0] = 1.0
    held = asked[np.minimum(np.arange(len(path)), len(asked) - 1)]
    for command in np.unique(held, axis=0):
        at = (held == command).all(axis=1)
        ahead = _way(*command.tolist())
        if ahead is None:
            continue
        points, directions = ahead
        placed = np.exp(1j * heading_rad[at])[:, None] * points
        positions[at, :, 0] = path[at, :1] + np.real(placed)
        positions[at, :, 1] = path[at, 1:] + np.imag(placed)
        positions[at, :, 2] = 0.0
        half = (heading_rad[at][:, None] + directions) / 2
        wxyzs[at, :, 0], wxyzs[at, :, 3] = np.cos(half), np.sin(half)
    return positions.astype(np.float32), wxyzs.astype(np.float32)


def _way(
    forward: float, left: float, yaw: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Marks [W], x + iy m in the frame of the base, and directions [W] rad.

    They are the path of a point before the base, which moves with it as it was told, so
    that they also show a turn on the spot. None where it is told to stand.
    """
    velocity = complex(forward, left)
    if abs(velocity) < _STILL and abs(yaw) < _STILL:
        return None
    side = velocity / abs(velocity) if abs(velocity) >= _STILL else 1.0
    start = _FROM_BASE_M * side
    time_s = np.linspace(0.0, AHEAD_S, MARKS)
    turned = np.exp(1j * yaw * time_s)
    # The integral of `turned`, without a division by a yaw of 0.
    came = velocity * time_s * np.exp(0.5j * yaw * time_s)
    came *= np.sinc(0.5 * yaw * time_s / np.pi)
    return start * turned + came, np.angle((velocity + 1j * yaw * start) * turned)
