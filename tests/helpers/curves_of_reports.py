"""Whether reports draw their curves, of which each takes half a second."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from matplotlib.axes import Axes

from gaitpref.loop import run_report
from gaitpref.report import answer_credit, pictures, trust_section

_PARTS = (run_report, answer_credit, trust_section)


def _blank(axes: Axes, alt: str = "") -> str:
    return ""


@contextmanager
def blank() -> Iterator[None]:
    """A dozen of them stand in the report of every round."""
    with pytest.MonkeyPatch.context() as patch:
        for part in _PARTS:
            patch.setattr(part, "svg_of", _blank)
        yield


@contextmanager
def drawn() -> Iterator[None]:
    """As they are for everybody else."""
    with pytest.MonkeyPatch.context() as patch:
        for part in _PARTS:
            patch.setattr(part, "svg_of", pictures.svg_of)
        yield
