"""`gaitpref answer`: a simulated rater answers the open pairs."""

from __future__ import annotations

from data.datasets.gone import pairs_gone
from gaitpref.cli.options import options
from gaitpref.cli.shared.dataset_argument import open_dataset
from gaitpref.cli.shared.rater_arguments import rater_cfg
from gaitpref.console.progress import console, counted
from gaitpref.raters.criteria import load_criterion
from gaitpref.raters.criterion_scores import context_of_dataset
from gaitpref.raters.simulated import answer_pairs


def run(command: options.Answer) -> int:
    """Run the command; gives the exit code."""
    dataset = open_dataset(command)
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
    if gone := pairs_gone(dataset):
        console.print(gone)
    console.next(
        f"`gaitpref fit --dataset {command.dataset} --out REWARD` fits a reward to them"
    )
    return 0
