"""The loop: the stages of every round in their order."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path

from data.answers.address import Address
from data.datasets.dataset import Dataset
from data.files.lock import only_writer
from gaitpref.console.progress import console, counted
from gaitpref.programs.program_answers import program_rater
from gaitpref.programs.program_cfg import ReachCfg
from gaitpref.programs.program_trust import require_teaching
from gaitpref.report.journal import note_round, note_start
from policy.parallel.ranks import ALONE, Ranks

from .between_rounds import meanwhile
from .fit_stage import fit_stage
from .loop_cfg import LoopCfg, RunError
from .people import People
from .policy_stage import policy_stage, train_along
from .questions_stage import questions_stage
from .record_stage import record_stage
from .report_stage import report_stage
from .run_config import CONFIG_NAME, claim
from .run_dir import Round, context_of
from .run_inputs import inputs_of
from .run_report import PAGE_NAME, write_report
from .show_stage import show_stage
from .verdict_stage import approval_stage, verdict_stage

OpenPage = Callable[[Dataset], AbstractContextManager[People]]
"""Lets people in to the run's data set while the loop runs."""


def no_page(dataset: Dataset) -> AbstractContextManager[People]:
    """Nobody is let in."""
    return nullcontext(People())


def run_loop(
    run: Path,
    cfg: LoopCfg,
    *,
    open_page: OpenPage = no_page,
    answers: Address | None = None,
    reach: ReachCfg | None = None,
    ranks: Ranks = ALONE,
    command: str = "",
) -> Path:
    """Run or go on with the loop of `cfg` in the directory `run`.

    Args:
        run: The run's directory.
        cfg: Everything that decides how the run goes.
        open_page: Lets people in while it runs.
        answers: Where pairs and answers are kept, if not in a file of the run. It is
            no part of the configuration: it may hold a password.
        reach: How a vision model that answers is reached; no part of the configuration
            either.
        ranks: Processes that train together, each of which calls this with the same
            arguments; the first one does all the rest alone.
        command: What was typed, for the run's journal.

    Raises:
        GaitprefError: what it is begun with cannot be used, or not together.
    """
    if cfg.method.learner is not None and ranks.size > 1:
        raise RunError(
            "--algorithm fastsac learns in one process: start the loop without "
            "torchrun, or leave it out"
        )
    if ranks.is_first:
        with only_writer(run, console.print):
            reached = reach or ReachCfg()
            _run(run, cfg, open_page, answers, reached, ranks, command)
        ranks.end()
    else:
        train_along(run, cfg, inputs_of(cfg).robot, answers, ranks)
    return run / PAGE_NAME


def _run(
    run: Path,
    cfg: LoopCfg,
    open_page: OpenPage,
    answers: Address | None,
    reach: ReachCfg,
    ranks: Ranks,
    command: str,
) -> None:
    inputs = inputs_of(cfg)
    robot, criterion = inputs.robot, inputs.criterion
    program = None
    if cfg.program is not None:
        program = program_rater(cfg.program, reach)
        if not (run / CONFIG_NAME).exists():
            require_teaching(cfg.program)
    claim(run, cfg, inputs.contents)
    unfinished = not Round(run, cfg.rounds).report.exists()
    if unfinished and (changed := note_start(run, command, ranks.size)):
        console.print(
            f"the run was begun otherwise ({changed}): it goes on, but its files will "
            "not be those it would have come to"
        )
    dataset = Dataset.create(run / "dataset", answers=answers)
    with (
        open_page(dataset) as visitors,
        meanwhile(run, cfg, visitors, answers) as asking,
    ):
        people = replace(asking.people, program=program)
        for number in range(cfg.rounds + 1):
            round = Round(run, number)
            round.root.mkdir(parents=True, exist_ok=True)
            context = context_of(cfg, round)
            policy_stage(cfg, round, context, robot, dataset, people, ranks)
            if number < cfg.rounds:
                record_stage(cfg, round, dataset, people)
                show_stage(cfg, round, context, dataset, people)
                asking.rest()
                questions_stage(cfg, round, context, dataset, criterion, people)
                asking.before(number + 1)
                approval_stage(cfg.method, round, context, dataset)
                fit_stage(cfg, round, context, dataset, people)
            else:
                show_stage(cfg, round, context, dataset, people)
                asking.rest()
                verdict_stage(cfg, round, context, dataset, criterion, people)
            report_stage(cfg, round, dataset, criterion)
            note_round(run, number)
            with counted(f"round {number}: writing the report, pictures") as tell:
                write_report(run, tell)
