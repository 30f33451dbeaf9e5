"""Figures in one style, as SVG text or as files; equal figures are equal bytes."""

from __future__ import annotations

import io
from pathlib import Path

import matplotlib
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


def plain_axes(axes: Axes, title: str) -> Axes:
    """The axes with their title, a light grid and no box."""
    axes.set_title(title, fontsize=10)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.3)
    return axes


def svg_of(axes: Axes) -> str:
    """The figure of the axes as an SVG element."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    svg = _encoded(figure, ".svg").decode()
    return svg[svg.index("<svg") :]


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
