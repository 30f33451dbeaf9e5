"""Criteria as scores of rollouts, for any robot."""

from __future__ import annotations

from torch import Tensor

from policy.env.env_cfg import EnvCfg
from policy.env.task_reward import task_reward_for
from policy.robots.robot import Robot
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
