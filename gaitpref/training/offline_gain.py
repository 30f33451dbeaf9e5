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
    """A policy that was learned from data alone, beside what it was learned from."""

    before: Evaluation | float
    """Of the policy it began from; without one, what the remembered steps are paid over
    an episode that none of them ends."""
    after: Evaluation

    @property
    def gained(self) -> bool:
        """Whether the later one earns more, with a probability of 97.5 %."""
        before, spread = _earned(self.before)
        either = math.hypot(spread, self.after.return_ci95)
        return self.after.return_mean - before > either

    @property
    def words(self) -> str:
        """What to say of it."""
        after = return_text(*_earned(self.after))
        if isinstance(self.before, Evaluation):
            of = f"what it began from {return_text(*_earned(self.before))}"
            instead = "keep the first"
        else:
            of = f"who made the data {self.before:.2f} in as many steps"
            instead = "begin from a policy, with --init"
        told = f"tried, it earns {after} an episode, and {of}"
        if self.gained:
            return told
        return (
            f"{told}: the data alone gained nothing; {instead}, record episodes "
            "of more kinds, or leave --offline out, so that it tries what it learns"
        )


def _earned(told: Evaluation | float) -> tuple[float, float]:
    """A return and half of its interval; all of memory is no sample."""
    if isinstance(told, Evaluation):
        return told.return_mean, told.return_ci95
    return told, 0.0


def offline_gain(
    before: Policy | float,
    after: Policy,
    robot: Robot,
    env: EnvCfg,
    reward: ScoreFn | None,
) -> OfflineGain:
    """Roll policies out under `env`, from the same starts, and score them by `reward`,
    as it is paid for a step; None is the task's own."""

    cfg = task_reward_for(robot, env.task)

    def per_second(features: Tensor, starts: Tensor) -> Tensor:
        if reward is not None:
            return reward(features, starts) / env.control_dt_s
        return task_score(features, cfg, control_dt_s=env.control_dt_s)

    if not isinstance(before, Policy):
        return OfflineGain(before, evaluate(after, per_second, env=env))
    return OfflineGain(
        evaluate(before, per_second, env=env), evaluate(after, per_second, env=env)
    )
