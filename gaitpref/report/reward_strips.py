"""A reward in pictures: a clip as a strip, and the curve of each habit it looks at.

Shapes: T steps, F features.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from data.datasets.dataset import EpisodeEntry
from data.episodes.clips import Clip
from data.episodes.command_words import words_of_command
from data.episodes.stances import stance_phases
from data.features import LEGS, column
from rewardmodel.descriptors.row import Habit
from rewardmodel.explain.attribution import Explanation
from rewardmodel.explain.four_ways import FourWays, Run, four_ways
from rewardmodel.explain.learned_curves import Curve

from .pictures import BLUE, GREY, RED, Margins, panels, plain_axes

ROBOTS = (BLUE, RED, GREY)
"""Of what is told apart within one clip."""
_STRIPS = Margins(left=0.9, right=0.75, between_rows=0.25)
_CURVES = Margins(top=0.45, between_rows=0.95)
_LINE = 36
"""Letters over a curve."""
_CONTACT, _FALLEN = column("foot_contact"), column("fallen")
_BAR = 0.7
"""Of the room of a leg."""


@dataclass(frozen=True, eq=False)
class Footfalls:
    """The feet of one robot in one clip."""

    contact: np.ndarray
    """[T, 4] bool: which foot is on the ground."""
    fell: bool

    @classmethod
    def of(cls, rows: np.ndarray) -> Footfalls | None:
        """The feet in rows [T, F] of a clip; None where nobody measured them."""
        contact = rows[:, _CONTACT]
        if np.isnan(contact).any():
            return None
        return cls(contact > 0.5, bool((rows[:, _FALLEN] > 0.5).any()))

    @property
    def words(self) -> str:
        """The same for who does not see it."""
        down = self.contact.mean(axis=0)
        told = ", ".join(
            f"{leg} {share:.0%}" for leg, share in zip(LEGS, down, strict=True)
        )
        return f"feet on the ground: {told} of the time" + "; it falls" * self.fell

    def draw(self, axes: Axes, start_s: float, dt_s: float) -> None:
        """A bar for each stance, in a row for each leg; red where the robot falls."""
        plain_axes(axes, "")
        axes.grid(False)
        for leg in range(len(LEGS)):
            stances = [
                (start_s + first * dt_s, (stop - first) * dt_s)
                for first, stop in stance_phases(self.contact[:, leg])
            ]
            axes.broken_barh(stances, (leg - _BAR / 2, _BAR), facecolor=BLUE)
        if self.fell:
            end_s = start_s + len(self.contact) * dt_s
            axes.axvspan(end_s - dt_s, end_s, color=RED, linewidth=0)
        axes.set_yticks(range(len(LEGS)), LEGS)
        axes.set_ylim(len(LEGS) - 0.5, -0.5)
        axes.set_ylabel("feet down", fontsize=9)


def clip_picture(
    shown: Explanation,
    entry: EpisodeEntry,
    clip: Clip,
    reward: float,
    runs: Sequence[Run] = (),
    feet: Footfalls | None = None,
) -> Figure:
    """A clip in up to five rows over time: its reward with the ensemble's spread, the
    shares of habits, which foot stands, and the shares of what was chosen and of each
    robot, as far as there are any."""
    heights = [1.0, 1.1 + 0.06 * max(0, len(shown.groups) - 6)]
    heights += [0.55] * (feet is not None)
    heights += [0.35] * bool(runs) + [0.8] * (shown.robots is not None)
    heights = [1.5 * height for height in heights]
    axes = panels((5.0,), heights, _STRIPS, sharex=True)
    above, below, *others = axes[:, 0]
    rows = iter(others)
    figure = above.figure
    dt_s = entry.meta.control_dt_s
    time_s = (clip.start + np.arange(clip.steps)) * dt_s
    asked = words_of_command(entry.meta.command)
    plain_axes(above, f"reward {reward:+.2f}; asked for {asked}")
    above.axhline(shown.average, color=GREY, linestyle=":", linewidth=1)
    band = (shown.reward - shown.spread, shown.reward + shown.spread)
    above.fill_between(time_s, *band, color=BLUE, alpha=0.2, linewidth=0)
    above.plot(time_s, shown.reward, color=BLUE, linewidth=1.3)
    above.set_ylabel("reward", fontsize=9)

    plain_axes(below, "")
    limit = float(np.abs(shown.shares).max()) or 1.0
    image = below.imshow(
        shown.shares.T,
        cmap="RdBu",
        vmin=-limit,
        vmax=limit,
        aspect="auto",
        interpolation="nearest",
        extent=(time_s[0], time_s[-1] + dt_s, len(shown.groups) - 0.5, -0.5),
    )
    below.set_yticks(range(len(shown.groups)), shown.groups)
    below.grid(False)
    parts = four_ways(shown, control_dt_s=dt_s, runs=runs)
    if feet is not None:
        feet.draw(next(rows), time_s[0], dt_s)
    if runs:
        _choices_row(next(rows), runs, parts, time_s[0], dt_s)
    if shown.robots is not None:
        _robots_row(next(rows), shown.robots, parts, time_s)
    axes[-1, 0].set_xlabel("time in the episode, s", fontsize=9)
    bar = figure.colorbar(image, cax=below.inset_axes((1.01, 0.0, 0.03, 1.0)))
    bar.set_label("liked", fontsize=8)
    bar.ax.tick_params(labelsize=7)
    return figure


def _choices_row(
    axes: Axes, runs: Sequence[Run], parts: FourWays, start_s: float, dt_s: float
) -> None:
    """What was chosen when, and what of the mean reward came of it."""
    plain_axes(axes, "")
    axes.grid(False)
    names = list(parts.choices)
    for name, first, stop in runs:
        colour = ROBOTS[names.index(name) % len(ROBOTS)]
        left, width = start_s + first * dt_s, (stop - first) * dt_s
        axes.barh(0, width, left=left, color=colour, alpha=0.35, height=1.0)
        axes.text(left + width / 2, 0, name, ha="center", va="center", fontsize=8)
    axes.set_yticks([])
    told = ", ".join(f"{name} {share:+.2f}" for name, share in parts.choices.items())
    axes.set_title(f"by choice: {told}; together {parts.whole:+.2f}", fontsize=8)


def _robots_row(
    axes: Axes, robots: np.ndarray, parts: FourWays, time_s: np.ndarray
) -> None:
    """What each robot earns over time; both together are the reward."""
    plain_axes(axes, "")
    for (name, share), own, colour in zip(
        parts.robots.items(), robots.T, ROBOTS, strict=False
    ):
        label = f"{name} {share:+.2f}"
        axes.plot(time_s, own, color=colour, linewidth=1.3, label=label)
    axes.axhline(0.0, color=GREY, linestyle=":", linewidth=1)
    axes.set_ylabel("share", fontsize=9)
    axes.legend(fontsize=8, loc="upper right", ncols=2, frameon=False)
    axes.set_title(f"by robot; together {parts.whole:+.2f}", fontsize=8)


def curves_picture(curves: Sequence[Curve]) -> Figure:
    """What each habit adds to the reward, over what was judged, with the spread."""
    columns = min(3, len(curves))
    rows = -(-len(curves) // columns)
    grid = panels([2.2] * columns, [1.4] * rows, _CURVES, sharey=True)
    for axes, curve in zip(grid.flat, curves, strict=False):
        plain_axes(axes, _meaning(curve.habit)).title.set_fontsize(9)
        band = (curve.reward - curve.spread, curve.reward + curve.spread)
        axes.fill_between(curve.values, *band, color=BLUE, alpha=0.2, linewidth=0)
        axes.plot(curve.values, curve.reward, color=BLUE, linewidth=1.5)
        axes.axhline(0.0, color=GREY, linestyle=":", linewidth=1)
        unit = curve.habit.unit.replace("2", "²")
        name = curve.habit.name + ("" if unit == "1" else f", {unit}")
        axes.set_xlabel(name, fontsize=8)
    for axes in grid.flat[len(curves) :]:
        axes.set_visible(False)
    for axes in grid[:, 0]:
        axes.set_ylabel("adds to the reward", fontsize=9)
    return grid[0, 0].figure


def _meaning(habit: Habit) -> str:
    """What the habit is in words, on two lines."""
    if habit.meaning.startswith("the same"):
        return habit.name.removesuffix("_sq").replace("_", " ") + ", squared"
    first = re.split("[;:]", habit.meaning)[0]
    return "\n".join(textwrap.wrap(first, _LINE, max_lines=2, placeholder=" ..."))
