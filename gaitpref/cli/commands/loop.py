"""`gaitpref loop`: train, record, ask, fit, retrain, round after round."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

from data.datasets.dataset import Dataset
from gaitpref.cli.options import options
from gaitpref.cli.options.options import Loop
from gaitpref.cli.shared.as_typed import as_typed
from gaitpref.cli.shared.dataset_argument import address
from gaitpref.cli.shared.launched import ranks_of_launch
from gaitpref.cli.shared.loop_arguments import resolve
from gaitpref.cli.shared.rater_arguments import reach_of
from gaitpref.cli.shared.simulator import require_sim
from gaitpref.console.browser import open_page
from gaitpref.console.extras import require
from gaitpref.console.progress import console
from gaitpref.loop.people import People
from gaitpref.loop.run import no_page, run_loop
from gaitpref.loop.run_dir import Round
from gaitpref.report.verdict import play_command


def run(command: options.Loop) -> int:
    """Run the command; gives the exit code."""
    cfg = resolve(command)
    require_sim(cfg.steps.sim)
    human = cfg.rater == "human"
    with ranks_of_launch() as ranks:
        page = run_loop(
            command.run,
            cfg,
            open_page=partial(page_of_loop, command) if human else no_page,
            answers=address(command.answers),
            reach=reach_of(command.asking),
            ranks=ranks,
            command=as_typed("loop", command),
        )
    console.print(f"the report is {page}")
    if ranks.is_first and not Round(command.run, cfg.rounds).verdict.exists():
        first, last = (Round(command.run, n).policy for n in (0, cfg.rounds))
        console.next(f"`{play_command(last, first)}` shows before and after")
    if command.page.open and not human and ranks.is_first:
        open_page(page.resolve().as_uri())
    return 0


@contextmanager
def page_of_loop(options: Loop, dataset: Dataset) -> Iterator[People]:
    """The labeling page of a run, up over all its rounds.

    Raises:
        GaitprefError: it cannot be served, as where the port is busy.
    """
    # A loop without people needs no viser.
    command = require("gaitpref.cli.commands.label", "label")
    page = require("gaitpref.loop.label_page", "label")
    cfg = command.label_cfg(options.page)
    with page.loop_page(dataset.root, cfg) as (notices, opened):
        os.nice(page.NICENESS)
        for line in command.greeting(notices, dataset.root, cfg):
            console.print(line)
        if options.page.open:
            open_page(opened.url)
        people = People(announce=opened.announce, require_page=opened.require)
        if options.patience is not None:
            people = replace(people, patience_s=60 * options.patience)
        yield people
