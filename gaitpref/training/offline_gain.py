"""What learning without a step was worth, once it is tried."""

from __future__ import annotations

import math
from dataclasses import dataclass

from torch import Tensor

from gaitpref.report.return_text import return_text
from policy.env.env_cfg import EnvCfg
from policy.env.task_reward import task_reward_for, task_score
from policy.robots.robot import Robot
from policy.rollouts.evaluate import Evaluation, evaluate
from policy.training.checkpoint import Policy
from policy.training.ppo import ScoreFn


@dataclass(frozen=True)
class OfflineGain:
    """A policy that was learned from data alone, beside the one it began from."""

    before: Evaluation
    after: Evaluation

    @property
    def gained(self) -> bool:
        """Whether the later one earns more, with a probability of 97.5 %."""
        either = math.hypot(self.before.return_ci95, self.after.return_ci95)
        return self.after.return_mean - self.before.return_mean > either

    @property
    def words(self) -> str:
        """What to say of it."""
        before, after = (
            return_text(each.return_mean, each.return_ci95)
            for each in (self.before, self.after)
        )
        told = f"tried, it earns {after} an episode, and what it began from {before}"
        if self.gained:
            return told
        return (
            f"{told}: the data alone gained nothing; keep the first, record episodes "
            "of more kinds, or leave --offline out, so that it tries what it learns"
        )


def offline_gain(
    before: Policy, after: Policy, robot: Robot, env: EnvCfg, reward: ScoreFn | None
) -> OfflineGain:
    """Roll both out under `env`, from the same starts, and score them by `reward`; None
    is the task's own."""

    cfg = task_reward_for(robot, env.task)

    def task(features: Tensor, starts: Tensor) -> Tensor:
        del starts
        return task_score(features, cfg, control_dt_s=env.control_dt_s)

    score = reward or task
    return OfflineGain(
        evaluate(before, score, env=env), evaluate(after, score, env=env)
    )
