"""`gaitpref report`: the page of a run, written again."""

from __future__ import annotations

from gaitpref.cli.options import options
from gaitpref.console.progress import console
from gaitpref.loop.run_report import write_report


def run(command: options.Report) -> int:
    """Run the command; gives the exit code."""
    console.print(f"the report is {write_report(command.run)}")
    return 0
