"""A reward of sequences, paid step by step to trainers that want it at once.

Shapes: N environments, F feature columns, H steps looked back.
"""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from data.features import column
from gaitpref.raters.criterion_scores import criterion_context
from gaitpref.training.total_reward import load_score, total_reward
from policy.env.env_cfg import EnvCfg
from policy.env.known_terms import KnownTermsCfg
from policy.env.task_reward import task_reward_for, task_score
from policy.robots.robot import Robot
from policy.training.ppo import ScoreFn, history_of


class StepReward:
    """Pays what a reward of sequences would pay for the newest step of each.

    A reward that looks back sees the last H rows of every environment; `starts` tells
    it where an episode begins, as when a whole rollout is scored at once.
    """

    def __init__(self, reward_fn: ScoreFn, *, history: int | None = None) -> None:
        """Pay `reward_fn`, shown `history` steps, or as many as it says it looks at."""
        looks_at = history_of(reward_fn) + 1
        self._history: int = looks_at if history is None else history
        if self._history < 1:
            raise ValueError(f"history must be at least 1 step, got {history}")
        self._reward_fn = reward_fn
        self._rows: list[Tensor] = []
        self._starts: list[Tensor] = []

    @torch.inference_mode()
    def __call__(self, features: Tensor, starts: Tensor) -> Tensor:
        """Reward [N] of the steps `features` [N, F]; `starts` [N] mark first ones."""
        self._rows = [*self._rows, features][-self._history :]
        self._starts = [*self._starts, starts][-self._history :]
        window = torch.stack(self._rows)
        return self._reward_fn(window, torch.stack(self._starts))[-1]

    def forget(self) -> None:
        """Begin anew: all environments were reset."""
        self._rows, self._starts = [], []


def reward_named(
    name: str | Path,
    robot: Robot,
    env: EnvCfg,
    *,
    known: KnownTermsCfg | None = None,
    keep_task: bool = False,
    alive: float = 0.0,
) -> ScoreFn:
    """The reward per step that `gaitpref train --reward NAME` trains on.

    Args:
        name: `task`, a criterion, or the directory of a learned reward.
        robot: The robot.
        env: Its environment.
        known: Weights of the safety terms that are added to all but the task.
        keep_task: Keep the hand-written walking reward beside.
        alive: Paid per second without a fall beside the task alone; other rewards have
            it among the safety terms.

    Raises:
        GaitprefError: there is no such reward, or it cannot be used.
    """
    if str(name) == "task":
        cfg = task_reward_for(robot, env.task)

        def task(features: Tensor, starts: Tensor) -> Tensor:
            score = task_score(features, cfg, control_dt_s=env.control_dt_s)
            standing = 1.0 - features[..., column("fallen")][..., 0]
            return (score + alive * standing) * env.control_dt_s

        return task
    score = load_score(str(name), criterion_context(robot, env))
    return total_reward(
        score, robot, env, known=known or KnownTermsCfg(), keep_task=keep_task
    )
