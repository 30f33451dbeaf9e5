"""A clip as a strip: its reward over time, and the share of each group of habits."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from data.clips import Clip
from data.dataset import EpisodeEntry
from rewardmodel.explain import Explanation

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
