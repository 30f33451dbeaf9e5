"""A reward in pictures: a clip as a strip, and the curve of each habit it looks at."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from data.datasets.dataset import EpisodeEntry
from data.episodes.clips import Clip
from rewardmodel.explain.attribution import Explanation
from rewardmodel.explain.learned_curves import Curve

from .pictures import BLUE, GREY, plain_axes


def clip_picture(
    shown: Explanation, entry: EpisodeEntry, clip: Clip, reward: float
) -> Figure:
    """Reward with the ensemble's spread above, shares of the groups below."""
    figure = Figure(figsize=(6.4, 3.8), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1, 1.1))
    dt_s = entry.meta.control_dt_s
    time_s = (clip.start + np.arange(clip.steps)) * dt_s
    forward, left, yaw = entry.meta.command
    title = (
        f"Clip {clip.rollout[:8]} at {time_s[0]:.1f} s, reward {reward:+.2f}; asked "
        f"for {forward:.2f} m/s, {left:.2f} m/s, {yaw:.2f} rad/s"
    )
    plain_axes(above, title)
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
    below.set_xlabel("time in the episode, s", fontsize=9)
    bar = figure.colorbar(image, ax=below, pad=0.01)
    bar.set_label("liked", fontsize=8)
    bar.ax.tick_params(labelsize=7)
    return figure


def curves_picture(curves: Sequence[Curve]) -> Figure:
    """What each habit adds to the reward, over what was judged, with the spread."""
    columns = min(3, len(curves))
    rows = -(-len(curves) // columns)
    figure = Figure(figsize=(2.6 * columns, 2.1 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, sharey=True, squeeze=False).flatten()
    for axes, curve in zip(panels, curves, strict=False):
        plain_axes(axes, curve.habit.name)
        band = (curve.reward - curve.spread, curve.reward + curve.spread)
        axes.fill_between(curve.values, *band, color=BLUE, alpha=0.2, linewidth=0)
        axes.plot(curve.values, curve.reward, color=BLUE, linewidth=1.5)
        axes.axhline(0.0, color=GREY, linestyle=":", linewidth=1)
        unit = curve.habit.unit
        axes.set_xlabel("" if unit == "1" else unit, fontsize=9)
    for axes in panels[len(curves) :]:
        axes.set_visible(False)
    for axes in panels[::columns]:
        axes.set_ylabel("adds to the reward", fontsize=9)
    return figure
