"""`gaitpref answer`: a simulated rater answers the open pairs."""

from __future__ import annotations

from data.datasets.dataset import Dataset
from data.datasets.gone import pairs_gone
from data.errors import DatasetError
from gaitpref.cli.options import options
from gaitpref.cli.shared.dataset_argument import open_dataset
from gaitpref.cli.shared.rater_arguments import rater_cfg
from gaitpref.console.progress import console
from gaitpref.raters.criteria import CriterionContext, load_criterion
from gaitpref.raters.simulated import answer_pairs
from policy.env.env_cfg import EnvCfg
from policy.env.task_reward import task_reward_for
from policy.robots.robot import load_robot_xml


def run(command: options.Answer) -> int:
    """Run the command; gives the exit code."""
    dataset = open_dataset(command)
    cfg = rater_cfg(command)
    criterion = load_criterion(command.criterion, _context_of(dataset))
    rater = f"simulated:{command.criterion}"
    count = answer_pairs(dataset, criterion, rater_id=rater, seed=command.seed, cfg=cfg)
    console.print(
        f"{count} pairs of {command.dataset} were answered by {command.criterion}"
    )
    if gone := pairs_gone(dataset):
        console.print(gone)
    return 0


def _context_of(dataset: Dataset) -> CriterionContext:
    """The figures of the robot in the data set, out of its first episode."""
    entries = dataset.entries()
    if not entries:
        raise DatasetError(
            f"{dataset.root} holds no episode: `gaitpref record --policy POLICY "
            f"--dataset {dataset.root}` adds some"
        )
    episode = dataset.read(entries[0].sha256)
    meta = episode.meta
    robot = load_robot_xml(
        episode.mjcf, name=meta.robot, physics_dt_s=meta.physics_dt_s
    )
    return CriterionContext(
        task=task_reward_for(robot, EnvCfg().task), control_dt_s=meta.control_dt_s
    )
