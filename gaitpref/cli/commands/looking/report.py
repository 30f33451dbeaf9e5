"""`gaitpref report`: the page of a run, written again."""

from __future__ import annotations

from gaitpref.cli.options import options
from gaitpref.console.browser import open_page
from gaitpref.console.progress import console, counted
from gaitpref.loop.run_report import write_report


def run(command: options.Report) -> int:
    """Run the command; gives the exit code."""
    with counted("writing the report, pictures") as tell:
        page = write_report(command.run, tell)
    console.print(f"the report is {page}")
    if command.open:
        open_page(page.resolve().as_uri())
    else:
        console.next(f"`gaitpref report --run {command.run} --open` shows it")
    return 0
