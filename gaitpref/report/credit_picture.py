"""The credit of a pair as one figure: when, which habit, which choice, which robot."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rewardmodel.explain.credit import Credit

from .pictures import GREY, Margins, panels, plain_axes

LEFT, RIGHT = "#1d58bf", "#c2600c"
"""Colours of the clips, as on the labeling page."""
_MOST = 8
"""Shares that are drawn by name; the others are summed up."""
_TITLES = {"habit": "habits", "choice": "gaits", "robot": "robots"}


def credit_picture(credit: Credit, *, dt_s: float, title: str = "") -> Figure:
    """A row for moments and one for whatever else the lead is shared out by.

    Bars to the right, and above, speak for the left clip A, the others for B.
    """
    rows = {name: _few(dict(row)) for name, row in credit.rows.items()}
    heights = [1.2, *(0.24 * len(row) for row in rows.values())]
    names = [name for row in rows.values() for name in row]
    first, *others = panels((5.3,), heights, _beside(names))[:, 0]
    better = "A" if credit.lead >= 0 else "B"
    told = title or "what moved the reward"
    plain_axes(first, f"{told}: {better} leads by {abs(credit.lead):.2f}")
    first.title.set_horizontalalignment("left")
    first.title.set_x(0.0)
    for values, color, clip in zip(
        credit.moments, (LEFT, RIGHT), ("A", "B"), strict=True
    ):
        time_s = dt_s * np.arange(len(values))
        first.fill_between(
            time_s, values, step="post", color=color, alpha=0.3, linewidth=0, label=clip
        )
    both = _together(credit.moments)
    time_s = dt_s * np.arange(len(both))
    first.step(time_s, both, where="post", color="black", linewidth=1.2, label="both")
    first.axhline(0.0, color=GREY, linewidth=1)
    first.legend(
        fontsize=7,
        frameon=False,
        ncols=3,
        loc="lower right",
        bbox_to_anchor=(1.0, 0.98),
        borderaxespad=0.0,
    )
    first.set_xlabel("time in the clip, s", fontsize=8)
    first.set_ylabel("speaks for A", fontsize=8)
    for axes, (name, row) in zip(others, rows.items(), strict=True):
        _bars(axes, _TITLES.get(name, name), row)
    return first.figure


def _beside(names: Iterable[str]) -> Margins:
    """Room at the left for names of bars, whose letters are 0.07 inches wide."""
    letters = max(map(len, names), default=0)
    return Margins(left=max(0.75, 0.45 + 0.075 * letters), bottom=0.3)


def _bars(axes: Axes, title: str, row: dict[str, float]) -> None:
    plain_axes(axes, "")
    axes.set_ylabel(title, fontsize=8)
    colors = [LEFT if value >= 0 else RIGHT for value in row.values()]
    places = range(len(row))
    axes.barh(places, list(row.values()), color=colors, height=0.7)
    axes.set_yticks(places, list(row))
    axes.invert_yaxis()
    axes.axvline(0.0, color=GREY, linewidth=1)
    for place, value in enumerate(row.values()):
        side = "left" if value >= 0 else "right"
        axes.annotate(
            # Adding 0 takes the sign off what is rounded to nothing.
            f"{round(value, 2) + 0.0:+.2f}",
            (value, place),
            xytext=(3 if value >= 0 else -3, 0),
            textcoords="offset points",
            va="center",
            ha=side,
            fontsize=7,
        )
    most = max((abs(value) for value in row.values()), default=1.0) or 1.0
    axes.set_xlim(-1.25 * most, 1.25 * most)


def _together(moments: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """[K] of the longer clip: what both add at the same time."""
    both = np.zeros(max(map(len, moments)))
    for values in moments:
        both[: len(values)] += values
    return both


def _few(row: dict[str, float]) -> dict[str, float]:
    """The largest shares by name, and the sum of the others."""
    if len(row) <= _MOST:
        return row
    named = dict(list(row.items())[: _MOST - 1])
    return named | {"all else": sum(row.values()) - sum(named.values())}
