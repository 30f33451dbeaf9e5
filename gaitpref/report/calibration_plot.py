"""The reliability plot: is "80 % sure" right in 80 % of the cases?"""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rewardmodel.measures.calibration import Calibration
from rewardmodel.models.fit_report import wilson_interval
from rewardmodel.trust.held_out_report import Foreseen

from .pictures import BLUE, GREY, panels, plain_axes


def reliability_plot(foreseen: Foreseen) -> Figure:
    """Share of right predictions against confidence, before and after the temperature.

    Bars are 95 % intervals of the share; the diagonal is perfect.
    """
    axes = panels((3.8,), (3.1,))[0, 0]
    plain_axes(axes, "Held-out answers: how sure, and how right")
    axes.plot((0.5, 1), (0.5, 1), ":", color=GREY, linewidth=1)
    _draw(axes, foreseen.uncalibrated, GREY, "s--", "at temperature 1", bars=False)
    name = f"at temperature {foreseen.temperature:.2f}"
    _draw(axes, foreseen.calibrated, BLUE, "o-", name, bars=True)
    axes.set_xlabel("Probability given to the clip predicted to win", fontsize=9)
    axes.set_ylabel("Share of answers for that clip", fontsize=9)
    axes.set_xlim(0.49, 1.01)
    axes.set_ylim(0, 1.02)
    if foreseen.calibrated is not None:
        axes.legend(fontsize=8, frameon=False, loc="lower right")
    else:
        axes.text(0.75, 0.3, "no held-out preference", ha="center", color=GREY)
    return axes.figure


def _draw(
    axes: Axes,
    found: Calibration | None,
    color: str,
    style: str,
    name: str,
    *,
    bars: bool,
) -> None:
    if found is None:
        return
    sure = [part.confidence for part in found.bins]
    right = [part.right for part in found.bins]
    label = f"{name}: error {found.ece:.2f}"
    axes.plot(sure, right, style, color=color, markersize=4, linewidth=1, label=label)
    for part in found.bins if bars else ():
        interval = wilson_interval(part.right * part.alike, part.alike)
        axes.plot([part.confidence] * 2, interval, color=color, alpha=0.4)
