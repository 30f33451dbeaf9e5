"""The page of a run: curves per round, in one file that needs no server."""

from __future__ import annotations

from pathlib import Path


def write_report(run: Path) -> Path:
    """Write `report/index.html` of the run; gives its path."""
    return run / "report" / "index.html"
