"""Figures in one style, as SVG text or as files; equal figures are equal bytes."""

from __future__ import annotations

import html
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from data.errors import GaitprefError
from data.files.files import write_atomically

BLUE, GREY, RED = "#2563a8", "#8a94a0", "#b3382c"

_KINDS = (".svg", ".png")
_NO_METADATA = {
    ".svg": {"Creator": None, "Date": None, "Format": None, "Type": None},
    ".png": {"Software": None},
}


@dataclass(frozen=True, kw_only=True)
class Margins:
    """Room around and between the panels of a figure, in inches."""

    left: float = 0.65
    right: float = 0.15
    top: float = 0.3
    bottom: float = 0.45
    between_rows: float = 0.5
    between_columns: float = 0.2


def panels(
    widths: Sequence[float],
    heights: Sequence[float],
    margins: Margins = Margins(),
    *,
    sharex: bool = False,
    sharey: bool = False,
) -> np.ndarray:
    """Axes [rows, columns] of a new figure, of these widths and heights in inches.

    Places are given and not found by measuring every label, which takes twice as long
    as drawing.
    """
    columns, rows = len(widths), len(heights)
    width = sum(widths) + (columns - 1) * margins.between_columns
    height = sum(heights) + (rows - 1) * margins.between_rows
    whole_width = margins.left + width + margins.right
    whole_height = margins.bottom + height + margins.top
    return Figure(figsize=(whole_width, whole_height)).subplots(
        rows,
        columns,
        squeeze=False,
        sharex=sharex,
        sharey=sharey,
        width_ratios=widths,
        height_ratios=heights,
        gridspec_kw={
            "left": margins.left / whole_width,
            "right": 1 - margins.right / whole_width,
            "bottom": margins.bottom / whole_height,
            "top": 1 - margins.top / whole_height,
            "wspace": margins.between_columns * columns / sum(widths),
            "hspace": margins.between_rows * rows / sum(heights),
        },
    )


def plain_axes(axes: Axes, title: str) -> Axes:
    """The axes with their title, a light grid and no box."""
    axes.set_title(title, fontsize=10)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.3)
    return axes


def svg_of(axes: Axes, alt: str = "") -> str:
    """The figure of the axes as an SVG element; `alt` tells who does not see it."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    svg = _encoded(figure, ".svg").decode()
    svg = svg[svg.index("<svg") :]
    if not alt:
        return svg
    return svg.replace("<svg", f'<svg role="img" aria-label="{html.escape(alt)}"', 1)


def save_picture(figure: Figure, path: Path) -> None:
    """Write the figure to a file whose ending says what it is.

    Raises:
        GaitprefError: the ending is neither .svg nor .png.
    """
    if path.suffix not in _KINDS:
        raise GaitprefError(f"{path} must end in {' or '.join(_KINDS)}")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, _encoded(figure, path.suffix))


def _encoded(figure: Figure, suffix: str) -> bytes:
    stream = io.BytesIO()
    # A fixed salt and no date: equal runs give equal files.
    with matplotlib.rc_context({"svg.hashsalt": "gaitpref", "svg.fonttype": "none"}):
        figure.savefig(
            stream, format=suffix[1:], dpi=110, metadata=_NO_METADATA[suffix]
        )
    return stream.getvalue()
