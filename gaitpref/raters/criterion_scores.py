"""Criteria as scores of rollouts, for any robot."""

from __future__ import annotations

from torch import Tensor

from data.datasets.dataset import Dataset
from data.errors import DatasetError
from policy.env.env_cfg import EnvCfg
from policy.env.task_reward import task_reward_for
from policy.robots.robot import Robot, load_robot_xml
from policy.training.ppo import ScoreFn

from .criteria import Criterion, CriterionContext, SequenceCriterion


def criterion_context(robot: Robot, env: EnvCfg) -> CriterionContext:
    """The robot's figures for the built-in criteria."""
    return CriterionContext(
        task=task_reward_for(robot, env.task), control_dt_s=env.control_dt_s
    )


def score_of_criterion(criterion: Criterion) -> ScoreFn:
    """A criterion as a sequence score, whether it looks at one row or at several."""
    if isinstance(criterion, SequenceCriterion):
        return criterion

    def score(features: Tensor, starts: Tensor) -> Tensor:
        return criterion(features)

    return score


def context_of_dataset(dataset: Dataset) -> CriterionContext:
    """The figures of the robot in the data set, out of its first episode.

    Raises:
        DatasetError: it holds none.
    """
    entries = dataset.entries()
    if not entries:
        raise DatasetError(
            f"{dataset.root} holds no episode: `gaitpref record --policy POLICY "
            f"--dataset {dataset.root}` adds some"
        )
    if entries[0].meta.is_team:
        raise DatasetError(
            f"{dataset.root} shows teams of two: `gaitpref team answer --dataset "
            f"{dataset.root}` judges both"
        )
    episode = dataset.read(entries[0].sha256)
    meta = episode.meta
    robot = load_robot_xml(
        episode.mjcf, name=meta.robot, physics_dt_s=meta.physics_dt_s
    )
    return CriterionContext(
        task=task_reward_for(robot, EnvCfg().task), control_dt_s=meta.control_dt_s
    )
