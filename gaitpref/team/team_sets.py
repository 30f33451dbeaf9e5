"""Data sets of teams: what they hold, and the robot that walks in them."""

from __future__ import annotations

from collections.abc import Sequence
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


def first_team(dataset: Dataset) -> Episode:
    """An episode of the data set, which shows a team.

    Raises:
        GaitprefError: it holds none, or one that shows a robot alone.
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
    rates = {entry.meta.control_dt_s for entry in entries}
    if len(rates) > 1:
        told = ", ".join(f"{1 / rate:g} Hz" for rate in sorted(rates))
        raise GaitprefError(
            f"{dataset.root} holds teams that act at {told}: what a robot earns is "
            "counted in steps of one rate; keep each in a data set of its own"
        )
    return dataset.read(entries[0].sha256)


def require_alike(datasets: Sequence[Dataset]) -> None:
    """
    Raises:
        GaitprefError: one holds no team, or teams of other robots or another rate than
            the first.
    """
    metas = [first_team(dataset).meta for dataset in datasets]
    first = metas[0]
    for dataset, meta in zip(datasets, metas, strict=True):
        one, two = (
            (each.robot, each.model_sha256, each.control_dt_s) for each in (first, meta)
        )
        if one != two:
            raise GaitprefError(
                f"{dataset.root} holds teams of {meta.robot} at "
                f"{1 / meta.control_dt_s:g} Hz, {datasets[0].root} of {first.robot} at "
                f"{1 / first.control_dt_s:g} Hz: what a robot earns is counted in "
                "steps of one robot at one rate; fit them apart"
            )


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
