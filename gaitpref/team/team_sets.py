"""Data sets of teams: what they hold, and the robot that walks in them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace

from data.datasets.dataset import Dataset
from data.episodes.episode import Episode
from data.errors import GaitprefError
from gaitpref.raters.criteria import CriterionContext
from gaitpref.raters.criterion_scores import criterion_context
from policy.env.env_cfg import EnvCfg
from policy.robots.robot import Robot, load_robot_xml
from policy.team.pair_model import first_alone
from rewardmodel.team.stood_still import StandingCfg
from rewardmodel.team.team_reward import Walkers


def first_team(dataset: Dataset) -> Episode:
    """An episode of the data set, which shows a team.

    Raises:
        GaitprefError: it holds none, one that shows a robot alone, or teams of several
            robots or rates.
    """
    entries = dataset.entries()
    if not entries:
        raise GaitprefError(
            f"{dataset.root} holds no episode: `gaitpref team record --policy POLICY "
            f"--dataset {dataset.root}` adds some"
        )
    if alone := [entry for entry in entries if not entry.meta.is_team]:
        raise GaitprefError(
            f"{len(alone)} of {len(entries)} episodes of {dataset.root} show one robot "
            "alone: keep teams in a data set of their own, made by `gaitpref team "
            "record`"
        )
    walkers = {Walkers.of(entry.meta) for entry in entries}
    if len(walkers) > 1:
        raise GaitprefError(
            f"{dataset.root} holds teams of {_told(walkers)}: what a robot earns is "
            "counted in steps of one robot at one rate; keep each in a data set of its "
            "own"
        )
    return dataset.read(entries[0].sha256)


def require_alike(datasets: Sequence[Dataset]) -> None:
    """
    Raises:
        GaitprefError: one holds no team, or teams of other robots or another rate than
            the first.
    """
    first, *others = [Walkers.of(first_team(dataset).meta) for dataset in datasets]
    for dataset, walkers in zip(datasets[1:], others, strict=True):
        if walkers != first:
            raise GaitprefError(
                f"{dataset.root} holds teams of {_beside(walkers, first)}, "
                f"{datasets[0].root} of {first.words}: what a robot earns is counted "
                "in steps of one robot at one rate; fit them apart"
            )


def require_recorded(dataset: Dataset, walkers: Walkers) -> None:
    """
    Raises:
        GaitprefError: the data set holds teams of other robots or another rate than
            `walkers`, which are to be added.
    """
    for entry in dataset.entries():
        if (there := Walkers.of(entry.meta)) != walkers:
            raise GaitprefError(
                f"{dataset.root} holds teams of {there.words}, and this policy walks "
                f"{_beside(walkers, there)}: what a robot earns is counted in steps of "
                "one robot at one rate; give another --dataset"
            )


def _told(walkers: Iterable[Walkers]) -> str:
    counts = Counter(each.words for each in walkers)
    return " and ".join(
        words if count == 1 else f"{words} ({count} models of it)"
        for words, count in sorted(counts.items())
    )


def _beside(walkers: Walkers, other: Walkers) -> str:
    """`walkers` in words that tell them from `other`."""
    if walkers.words == other.words:
        return f"another model of {walkers.robot}"
    return walkers.words


def require_kind(dataset: Dataset, *, team: bool) -> None:
    """
    Raises:
        GaitprefError: the data set holds episodes of the other kind.
    """
    others = sum(entry.meta.is_team != team for entry in dataset.entries())
    if others:
        ours, theirs = ("teams", "one robot alone")[:: 1 if team else -1]
        raise GaitprefError(
            f"{others} episodes of {dataset.root} show {theirs}: keep {ours} in a data "
            "set of their own, or give another --dataset"
        )


def robot_of_teams(dataset: Dataset) -> tuple[Robot, float]:
    """A robot of the teams in a data set, and their control step."""
    episode = first_team(dataset)
    meta = episode.meta
    robot = load_robot_xml(
        first_alone(episode.mjcf), name=meta.robot, physics_dt_s=meta.physics_dt_s
    )
    return robot, meta.control_dt_s


def context_of_teams(robot: Robot, control_dt_s: float) -> CriterionContext:
    """The robot's figures for criteria."""
    return replace(criterion_context(robot, EnvCfg()), control_dt_s=control_dt_s)


def standing_of(robot: Robot) -> StandingCfg:
    """How this robot stands that does nothing."""
    return StandingCfg(height_m=0.95 * float(robot.home_qpos[2]))
