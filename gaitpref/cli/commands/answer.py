"""`gaitpref answer`: a simulated rater, or a program, answers the open pairs."""

from __future__ import annotations

from data.datasets.dataset import Dataset
from data.datasets.gone import pairs_gone
from data.errors import GaitprefError
from gaitpref.cli.options import options
from gaitpref.cli.options.program_options import Teaching
from gaitpref.cli.shared.dataset_argument import open_dataset
from gaitpref.cli.shared.next_of_answers import next_fit
from gaitpref.cli.shared.rater_arguments import program_of, rater_cfg, reach_of
from gaitpref.console.progress import console, counted
from gaitpref.programs.program_answers import answer_by_program, program_rater
from gaitpref.programs.program_cfg import ProgramCfg
from gaitpref.raters.criteria import load_criterion
from gaitpref.raters.criterion_scores import context_of_dataset
from gaitpref.raters.simulated import answer_pairs

SIMULATED = ("perfect", "stochastic")


def run(command: options.Answer) -> int:
    """Run the command; gives the exit code."""
    program = program_of(command.rater, SIMULATED, command.asking, Teaching())
    dataset = open_dataset(command)
    if program is None:
        _simulated(command, dataset)
    else:
        _by_program(command, program, dataset)
    if gone := pairs_gone(dataset):
        console.print(gone)
    console.next(next_fit(dataset))
    return 0


def _simulated(command: options.Answer, dataset: Dataset) -> None:
    if command.criterion is None:
        raise GaitprefError(
            "what does the simulated rater look for? --criterion high_step, or another"
        )
    if command.most is not None:
        raise GaitprefError(
            "--most is about a program: a simulated rater answers every open pair"
        )
    cfg = rater_cfg(command)
    criterion = load_criterion(command.criterion, context_of_dataset(dataset))
    rater = f"simulated:{command.criterion}"
    with counted("answering") as tell:
        count = answer_pairs(
            dataset, criterion, rater_id=rater, seed=command.seed, cfg=cfg, tell=tell
        )
    console.print(
        f"{count} pairs of {command.dataset} were answered by {command.criterion}"
    )
    with dataset.answers() as store:
        skipped = store.count(rater_id=rater, choice="skip")
    missing = {
        name
        for entry in dataset.entries()
        for name in entry.meta.extra.get("missing_features", "").split()
    }
    if skipped and missing:
        console.print(
            f"{skipped} were skipped: of a clip that lacks what {command.criterion} "
            f"looks at nobody can tell, and episodes here lack "
            f"{', '.join(sorted(missing))}"
        )


def _by_program(command: options.Answer, program: ProgramCfg, dataset: Dataset) -> None:
    if command.criterion is not None or command.erring != options.Erring():
        raise GaitprefError(
            "--criterion and how a simulated rater errs are not for a program, which "
            "looks at the clips itself: leave them out"
        )
    rate = program_rater(program, reach_of(command.asking))
    count = answer_by_program(
        dataset, rate, program, seed=command.seed, most=command.most
    )
    console.print(
        f"{count} pairs of {command.dataset} were answered by {program.rater_id}; "
        f"`gaitpref raters --dataset {command.dataset} compare` says how it agrees "
        "with people"
    )
