"""Irregular samples to values and velocities at chosen times.

Shapes: S samples, N times, D dimensions.
"""

from __future__ import annotations

import numpy as np

_DEGREE = 3
"""A cubic follows a gait's swing within the window; a straight line would lose 4 % of
a velocity at 2 Hz."""
_MIN_SAMPLES = 6


def split_at_gaps(times_s: np.ndarray, max_gap_s: float) -> list[tuple[float, float]]:
    """First and last time of every stretch [S] without a longer silence."""
    breaks = np.flatnonzero(np.diff(times_s) > max_gap_s)
    starts, stops = [0, *(breaks + 1)], [*breaks, len(times_s) - 1]
    bounds = zip(times_s[starts], times_s[stops], strict=True)
    return [(float(start), float(stop)) for start, stop in bounds]


def overlaps(
    left: list[tuple[float, float]], right: list[tuple[float, float]]
) -> list[tuple[float, float]]:
    """The stretches of time that lie in one of each list."""
    both = ((max(a, c), min(b, d)) for a, b in left for c, d in right)
    return [(start, stop) for start, stop in both if start < stop]


def interpolate(
    times_s: np.ndarray, values: np.ndarray, at_s: np.ndarray
) -> np.ndarray:
    """Values [S, D] at other times [N, D], in a straight line between two samples."""
    columns = [np.interp(at_s, times_s, column) for column in values.T]
    return np.stack(columns, axis=-1)


def interpolate_attitude(
    times_s: np.ndarray, wxyz: np.ndarray, at_s: np.ndarray
) -> np.ndarray:
    """Attitudes [S, 4] at other times [N, 4], turning evenly between two samples."""
    if len(times_s) == 1:
        return np.repeat(wxyz, len(at_s), axis=0)
    after = np.clip(np.searchsorted(times_s, at_s), 1, len(times_s) - 1)
    before = after - 1
    share = (at_s - times_s[before]) / (times_s[after] - times_s[before])
    turn = rotation_vectors(multiply(conjugate(wxyz[before]), wxyz[after]))
    part = np.clip(share, 0.0, 1.0)[:, None] * turn
    return multiply(wxyz[before], np.array([from_rotation_vector(v) for v in part]))


def hold(times_s: np.ndarray, values: np.ndarray, at_s: np.ndarray) -> np.ndarray:
    """The sample [N, D] that was the newest at each time, or the first one."""
    newest = np.searchsorted(times_s, at_s, side="right") - 1
    return values[np.maximum(newest, 0)]


def local_fit(
    times_s: np.ndarray, values: np.ndarray, at_s: np.ndarray, half_window_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Value and rate of change, each [N, D], of the cubic through the samples around.

    Args:
        times_s: [S], rising.
        values: [S, D].
        at_s: [N], within the samples.
        half_window_s: Samples this near count; more where they are sparse.
    """
    fitted = np.empty((len(at_s), values.shape[1]))
    slopes = np.empty_like(fitted)
    for row, time_s in enumerate(at_s):
        near = _near(times_s, time_s, half_window_s)
        fitted[row], slopes[row] = _cubic(times_s[near] - time_s, values[near])
    return fitted, slopes


def local_attitude(
    times_s: np.ndarray, wxyz: np.ndarray, at_s: np.ndarray, half_window_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Attitude [N, 4] and angular velocity in the body frame [N, 3], rad/s.

    Arguments as for `local_fit`, with attitudes [S, 4].
    """
    attitudes, rates = np.empty((len(at_s), 4)), np.empty((len(at_s), 3))
    for row, time_s in enumerate(at_s):
        near = _near(times_s, time_s, half_window_s)
        middle = wxyz[near][np.abs(times_s[near] - time_s).argmin()]
        turns = rotation_vectors(multiply(conjugate(middle), wxyz[near]))
        turn, slope = _cubic(times_s[near] - time_s, turns)
        attitudes[row] = multiply(middle, from_rotation_vector(turn))
        # The right Jacobian of a small turn.
        rates[row] = slope - np.cross(turn, slope) / 2
    return attitudes, rates


def _near(times_s: np.ndarray, time_s: float, half_window_s: float) -> slice:
    first, stop = np.searchsorted(
        times_s, (time_s - half_window_s, time_s + half_window_s)
    )
    if stop - first < _MIN_SAMPLES:
        middle = np.searchsorted(times_s, time_s)
        first = max(0, min(middle - _MIN_SAMPLES // 2, len(times_s) - _MIN_SAMPLES))
        stop = first + _MIN_SAMPLES
    return slice(first, stop)


def _cubic(offsets_s: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Value and slope at 0 of the least-squares cubic."""
    scale = np.abs(offsets_s).max() or 1.0
    powers = np.vander(offsets_s / scale, _DEGREE + 1, increasing=True)
    found = np.linalg.lstsq(powers, values, rcond=None)[0]
    return found[0], found[1] / scale


def multiply(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """The quaternions [..., 4] that turn by `right` first, then by `left`."""
    a, b = left[..., :1], left[..., 1:]
    c, d = right[..., :1], right[..., 1:]
    scalar = a * c - (b * d).sum(axis=-1, keepdims=True)
    return np.concatenate([scalar, a * d + c * b + np.cross(b, d)], axis=-1)


def conjugate(wxyz: np.ndarray) -> np.ndarray:
    """The turn back of unit quaternions [..., 4]."""
    return wxyz * np.array([1.0, -1.0, -1.0, -1.0])


def rotate(wxyz: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors [..., 3] from the body to the world."""
    pure = np.concatenate([np.zeros_like(vectors[..., :1]), vectors], axis=-1)
    return multiply(multiply(wxyz, pure), conjugate(wxyz))[..., 1:]


def rotation_vectors(wxyz: np.ndarray) -> np.ndarray:
    """Axis times angle [..., 3], rad, the short way round."""
    wxyz = np.where(wxyz[..., :1] < 0, -wxyz, wxyz)
    sine = np.linalg.norm(wxyz[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, wxyz[..., :1])
    return wxyz[..., 1:] * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0)


def from_rotation_vector(vector: np.ndarray) -> np.ndarray:
    """The unit quaternion [4] of axis times angle [3]."""
    angle = float(np.linalg.norm(vector))
    axis = vector / angle if angle > 1e-12 else vector
    return np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * axis])
