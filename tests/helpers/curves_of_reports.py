"""Whether reports draw their curves, of which each takes half a second."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

import pytest

from gaitpref.loop import run_report
from gaitpref.report import answer_credit, pictures, trust_section

_PARTS = (run_report, answer_credit, trust_section)


def blank() -> AbstractContextManager[None]:
    """A dozen of them stand in the report of every round."""
    return _drawn_by(lambda axes, alt="": "")


def drawn() -> AbstractContextManager[None]:
    """As they are for everybody else."""
    return _drawn_by(pictures.svg_of)


@contextmanager
def _drawn_by(svg_of: Callable[..., str]) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for part in _PARTS:
            patch.setattr(part, "svg_of", svg_of)
        yield
