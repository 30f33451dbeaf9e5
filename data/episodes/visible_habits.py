"""What an eye sees of a gait: habits of a clip, and from when on two clips differ.

Each habit is one number of a whole clip in the unit in which people speak of it, beside
the least difference that is noticed when two clips are played side by side, found by
looking at pairs below and above it. A reward sees other and finer habits, of each step.

Shapes: T steps, F features, H habits, C clips.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from data.features import column

Rows = Callable[[str], np.ndarray]
"""The columns [T, width] of a clip's feature of that name."""
DIAGONALS, SIDES = ((0, 3), (1, 2)), ((0, 2), (1, 3))
"""Legs, in the order of `data.features.LEGS`."""
NOTICED = 1.0
"""The least difference that people just notice, in the unit of `visible_habits`."""
FINE = 0.3
"""Below it nobody sees a difference, not even who looks for it (docs/benchmarks.md)."""
_LOW, _HIGH = 5.0, 95.0
"""Percentiles between which something goes to and fro: one jolt is no habit."""
_CHATTER_S = 0.08
"""Shorter than a swing or a stance: 0.13 s of a trot of 4 Hz."""


@dataclass(frozen=True, kw_only=True)
class VisibleHabit:
    """One thing people see of a gait."""

    name: str
    noticed: float
    """Least difference that is seen, in the unit of `compute`."""
    says: str
    """What the one with the higher value does; braces stand for the difference."""
    amount: Callable[[float], str]
    """A difference in words."""
    compute: Callable[[Rows, float], float]
    """Value of a clip, given its rows and the seconds from one to the next."""


def _cm(difference_m: float) -> str:
    return f"{100 * difference_m:.0f} cm"


def _m_s(difference_m_s: float) -> str:
    return f"{difference_m_s:.2f} m/s"


def _degrees(difference_deg: float) -> str:
    return f"{difference_deg:.0f}°"


def _percent(difference: float) -> str:
    return f"{difference:.0f} %"


def _number(difference: float) -> str:
    return f"{difference:.1f}"


def _mean(name: str, index: int = 0) -> Callable[[Rows, float], float]:
    return lambda rows, dt_s: float(rows(name)[:, index].mean())


def _tilt_deg(rows: Rows, index: int) -> np.ndarray:
    return np.degrees(np.arcsin(np.clip(rows("gravity_b")[:, index], -1.0, 1.0)))


def _range(values: np.ndarray) -> float:
    low, high = np.percentile(values, (_LOW, _HIGH))
    return float(high - low)


def _lifts_m(rows: Rows) -> np.ndarray:
    """[4] how high each foot comes."""
    return np.percentile(rows("foot_height"), _HIGH, axis=0)


def _speed_m_s(rows: Rows, dt_s: float) -> float:
    return float(np.linalg.norm(rows("base_lin_vel_b")[:, :2].mean(axis=0)))


def _settled(down: np.ndarray, dt_s: float) -> np.ndarray:
    """[T, 4] bool: what most of the steps around each say. A foot that chatters on the
    ground, or grazes it in a swing, takes no stride that anybody sees."""
    half = round(_CHATTER_S / 2 / dt_s)
    padded = np.pad(down, ((half, half), (0, 0)), mode="edge")
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1, axis=0)
    return around.mean(axis=-1) > 0.5


def _strides_hz(rows: Rows, dt_s: float) -> float:
    """From lift-off to lift-off of a leg: where the clip is cut makes no difference."""
    down = _settled(rows("foot_contact") > 0.5, dt_s)
    lifted = [np.flatnonzero(leg) for leg in (down[:-1] & ~down[1:]).T]
    strides = sum(max(0, len(steps) - 1) for steps in lifted)
    if strides == 0:
        return sum(map(len, lifted)) / 4 / (len(down) * dt_s)
    took = sum(int(steps[-1] - steps[0]) for steps in lifted if len(steps) > 1)
    return strides / (took * dt_s)


def _down_percent(rows: Rows, dt_s: float) -> float:
    return 100.0 * float((rows("foot_contact") > 0.5).mean())


def _together_percent(rows: Rows, pairs: Sequence[tuple[int, int]]) -> float:
    down = rows("foot_contact") > 0.5
    return 100.0 * float(np.mean([down[:, a] == down[:, b] for a, b in pairs]))


def _slip_m_s(rows: Rows, dt_s: float) -> float:
    down = rows("foot_contact") > 0.5
    return float((rows("foot_speed") * down).sum() / max(int(down.sum()), 1))


VISIBLE_HABITS = (
    VisibleHabit(
        name="fall",
        noticed=1.0,
        says="falls",
        amount=_number,
        compute=lambda rows, dt_s: float(rows("fallen").max()),
    ),
    VisibleHabit(
        name="trunk height",
        noticed=0.02,
        says="carries its trunk {} higher",
        amount=_cm,
        compute=_mean("base_height"),
    ),
    VisibleHabit(
        name="foot lift",
        noticed=0.02,
        says="lifts its feet {} higher",
        amount=_cm,
        compute=lambda rows, dt_s: float(_lifts_m(rows).mean()),
    ),
    VisibleHabit(
        name="uneven lift",
        noticed=0.04,
        says="lifts its feet less evenly, by {}",
        amount=_cm,
        compute=lambda rows, dt_s: float(np.ptp(_lifts_m(rows))),
    ),
    VisibleHabit(
        name="speed",
        noticed=0.1,
        says="goes {} faster",
        amount=_m_s,
        compute=_speed_m_s,
    ),
    VisibleHabit(
        name="turn",
        noticed=10.0,
        says="turns {} a second more to the left",
        amount=_degrees,
        compute=lambda rows, dt_s: float(
            np.degrees(rows("base_ang_vel_b")[:, 2].mean())
        ),
    ),
    VisibleHabit(
        name="steps",
        noticed=0.4,
        says="takes {} more strides a second",
        amount=_number,
        compute=_strides_hz,
    ),
    VisibleHabit(
        name="feet down",
        noticed=10.0,
        says="has its feet on the ground {} more of the time",
        amount=_percent,
        compute=_down_percent,
    ),
    VisibleHabit(
        name="diagonal legs",
        noticed=15.0,
        says="moves diagonal legs together {} more of the time",
        amount=_percent,
        compute=lambda rows, dt_s: _together_percent(rows, DIAGONALS),
    ),
    VisibleHabit(
        name="legs of a side",
        noticed=15.0,
        says="moves the legs of a side together {} more of the time",
        amount=_percent,
        compute=lambda rows, dt_s: _together_percent(rows, SIDES),
    ),
    VisibleHabit(
        name="slip",
        noticed=0.1,
        says="slips {} faster over the ground",
        amount=_m_s,
        compute=_slip_m_s,
    ),
    VisibleHabit(
        name="nose",
        noticed=4.0,
        says="carries its nose {} lower",
        amount=_degrees,
        compute=lambda rows, dt_s: float(_tilt_deg(rows, 0).mean()),
    ),
    VisibleHabit(
        name="lean",
        noticed=4.0,
        says="leans {} more to the left",
        amount=_degrees,
        compute=lambda rows, dt_s: float(_tilt_deg(rows, 1).mean()),
    ),
    VisibleHabit(
        name="bounce",
        noticed=0.02,
        says="bounces {} more",
        amount=_cm,
        compute=lambda rows, dt_s: _range(rows("base_height")),
    ),
    VisibleHabit(
        name="rocking",
        noticed=5.0,
        says="rocks from nose to tail by {} more",
        amount=_degrees,
        compute=lambda rows, dt_s: _range(_tilt_deg(rows, 0)),
    ),
    VisibleHabit(
        name="sway",
        noticed=5.0,
        says="sways from side to side by {} more",
        amount=_degrees,
        compute=lambda rows, dt_s: _range(_tilt_deg(rows, 1)),
    ),
)


def visible_habits(features: np.ndarray, dt_s: float) -> np.ndarray:
    """[H] habits of a clip, each in differences that are just noticed; NaN where a
    feature is missing.

    Args:
        features: [T, F] feature rows.
        dt_s: Time from one to the next.
    """

    def rows(name: str) -> np.ndarray:
        return features[:, column(name)].astype(float)

    return np.array([h.compute(rows, dt_s) / h.noticed for h in VISIBLE_HABITS])


def most_different(habits: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """[K] how much the clips of `pairs` [K, 2] differ in the habit in which they differ
    most; 0 where no habit is known of both.

    Args:
        habits: [C, H] as `visible_habits` gives them.
        pairs: Two indices into the clips each.
    """
    left, right = pairs.T
    most = np.zeros(len(pairs))
    for column_of_all in habits.T:
        apart = np.abs(column_of_all[left] - column_of_all[right])
        most = np.fmax(most, apart)
    return most


def differing(
    left: np.ndarray, right: np.ndarray, least: float = NOTICED
) -> list[VisibleHabit]:
    """The habits in which two clips differ by `least`, the plainest first.

    Args:
        left: [H] as `visible_habits` gives them.
        right: The same of the other clip.
        least: In differences that are just noticed.
    """
    apart = np.nan_to_num(np.abs(left - right))
    order = np.argsort(-apart, kind="stable")
    return [VISIBLE_HABITS[index] for index in order if apart[index] >= least]


def difference_words(
    left: np.ndarray, right: np.ndarray, least: float = NOTICED
) -> list[str]:
    """Sentences of clips A and B such as "B lifts its feet 3 cm higher.", the plainest
    first.

    Args:
        left: [H] of A, as `visible_habits` gives them.
        right: The same of B.
        least: What is told at least, in differences that are just noticed.
    """
    said = []
    for habit in differing(left, right, least):
        index = VISIBLE_HABITS.index(habit)
        lead = float(left[index] - right[index]) * habit.noticed
        does = habit.says.format(habit.amount(abs(lead)))
        said.append(f"{'AB'[lead < 0]} {does}.")
    return said
