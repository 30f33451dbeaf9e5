"""Figures as SVG."""

from __future__ import annotations

import pytest
from matplotlib.axes import Axes
from matplotlib.axis import Axis

from gaitpref.report.pictures import panels, plain_axes, svg_of


def _panel(*, measured: bool) -> Axes:
    axes = plain_axes(panels((2.0,), (1.0,))[0, 0], "a title")
    if measured:
        axes.set_title("a title", fontsize=10)
    axes.plot((0, 1, 2), (3, 1, 2))
    return axes


def test_the_labels_of_a_figure_are_measured_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What is drawn is the same as with matplotlib's own, dearer way."""
    as_measured = svg_of(_panel(measured=True))
    measured: list[Axis] = []
    sizes_of = Axis._get_ticklabel_bboxes

    def noted(axis: Axis, *args: object) -> object:
        measured.append(axis)
        return sizes_of(axis, *args)

    monkeypatch.setattr(Axis, "_get_ticklabel_bboxes", noted)
    assert svg_of(_panel(measured=False)) == as_measured
    assert len(measured) == 2  # Axes, x and y.
