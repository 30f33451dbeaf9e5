"""Figures as SVG."""

from __future__ import annotations

from typing import Any

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


def test_a_title_is_placed_without_measuring_labels(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What is drawn is the same as with matplotlib's own, dearer way."""
    as_measured = svg_of(_panel(measured=True))
    measured: list[Axis] = []
    size_of = Axis.get_tightbbox

    def noted(axis: Axis, *args: Any, **options: Any) -> object:
        measured.append(axis)
        return size_of(axis, *args, **options)

    monkeypatch.setattr(Axis, "get_tightbbox", noted)
    assert svg_of(_panel(measured=False)) == as_measured
    assert not measured
