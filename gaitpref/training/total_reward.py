"""The reward a policy is trained against: a score of choice plus the known terms.

Shapes: T steps of a rollout, N environments, F feature columns.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, runtime_checkable

import torch
from torch import Tensor

from data.features import column
from gaitpref.raters.criteria import CriterionContext, load_criterion
from gaitpref.raters.criterion_scores import score_of_criterion
from policy.env.env_cfg import EnvCfg
from policy.env.known_terms import KnownTermsCfg, known_terms
from policy.env.task_reward import (
    TaskRewardCfg,
    known_terms_for,
    task_reward_for,
    task_score,
)
from policy.robots.robot import Robot
from policy.training.ppo import ScoreFn, history_of
from rewardmodel.models.storage import load_reward

from .tracking_limit import Mean, TrackingLimit

_SPREAD_STRIDE = 4
"""Every how many of the environments is asked how unsure the ensemble is."""


@runtime_checkable
class Unsure(Protocol):
    """A reward that knows how unsure it is."""

    def spread(self, features: Tensor, starts: Tensor) -> Tensor:
        """Deviation [T, N] over an ensemble, for rows [T, N, F]."""
        ...


@dataclass(frozen=True, eq=False)
class TotalReward:
    """`w_learned * r_hat * dt`, the known terms, and the task where it is kept."""

    score: ScoreFn
    """Per second: a learned reward or a criterion."""
    weight: float
    """Weight of `score`."""
    known: KnownTermsCfg
    task: TaskRewardCfg | None
    """The hand-written reward that is kept beside; None keeps none."""
    joint_offset_range: Tensor
    """[12, 2] rad from the home pose"""
    control_dt_s: float
    tracking_limit: TrackingLimit | None = None
    """How badly commands may be followed before `score` counts less; None: it never
    does."""
    figures: dict[str, float] = field(default_factory=dict, compare=False)
    """Figures of the rollout scored last: each part per second (`reward/NAME`), its
    share of the magnitudes of all (`share/NAME`), and how unsure an ensemble is of the
    score (`reward/spread`, in its standard deviations)."""

    @property
    def history_steps(self) -> int:
        """Rows before a row that matter to its reward."""
        return history_of(self.score)

    @property
    def wanted(self) -> ScoreFn:
        """What is asked for, beside safety and the task."""
        return self.score

    def __call__(self, features: Tensor, starts: Tensor) -> Tensor:
        """Reward [T, N] per step of `features` [T, N, F], which are one rollout."""
        return self.of_rollout(features, starts, len(features))

    def of_rollout(
        self, features: Tensor, starts: Tensor, steps: int, mean: Mean = torch.mean
    ) -> Tensor:
        """Reward [steps, N] of the rollout that the last `steps` of `features`
        [T, N, F] are; only `score` looks back at those before it."""
        parts = self.parts(features, starts, steps, mean)
        self._measure(parts, features, starts, steps)
        return torch.stack(tuple(parts.values())).sum(dim=0)

    def _measure(
        self, parts: dict[str, Tensor], features: Tensor, starts: Tensor, steps: int
    ) -> None:
        means = {name: float(part.mean()) for name, part in parts.items()}
        sizes = {name: float(part.abs().mean()) for name, part in parts.items()}
        whole = sum(sizes.values()) or 1.0
        for name, mean in means.items():
            self.figures[f"reward/{name}"] = mean / self.control_dt_s
            self.figures[f"share/{name}"] = sizes[name] / whole
        if isinstance(self.score, Unsure):
            some = slice(None, None, _SPREAD_STRIDE)
            spread = self.score.spread(features[:, some], starts[:, some])
            self.figures["reward/spread"] = float(spread[-steps:].mean())

    def parts(
        self, features: Tensor, starts: Tensor, steps: int, mean: Mean = torch.mean
    ) -> dict[str, Tensor]:
        """What the total of the last `steps` is the sum of, by name, each
        [steps, N]."""
        score = self.score(features, starts)[-steps:]
        features = features[-steps:]
        standing = 1.0 - features[..., column("fallen")][..., 0]
        score = score * standing
        if self.tracking_limit is not None:
            score = score * self.tracking_limit.share(features, mean)
        parts = {"score": self.weight * self.control_dt_s * score}
        if self.tracking_limit is not None:
            cost = self.tracking_limit.cost(features, mean) * standing
            parts["tracking"] = -self.control_dt_s * cost
        parts |= known_terms(
            features,
            self.known,
            joint_offset_range=self.joint_offset_range,
            control_dt_s=self.control_dt_s,
        )
        if self.task is not None:
            task = task_score(features, self.task, control_dt_s=self.control_dt_s)
            parts["task"] = task * self.control_dt_s
        return parts


def total_reward(
    score: ScoreFn,
    robot: Robot,
    env: EnvCfg,
    *,
    known: KnownTermsCfg,
    weight: float = 1.0,
    keep_task: bool = False,
    tracking_limit: TrackingLimit | None = None,
) -> TotalReward:
    """`TotalReward` for a robot and its environment."""
    home = robot.home_joint_pos[:, None]
    # A joint without limits has an infinite range; 100 rad is as far.
    offsets = torch.tensor(robot.joint_range - home, dtype=torch.float32)
    task = task_reward_for(robot, env.task) if keep_task else None
    return TotalReward(
        score=score,
        weight=weight,
        known=known_terms_for(robot, known),
        task=task,
        joint_offset_range=offsets.clamp(-100.0, 100.0),
        control_dt_s=env.control_dt_s,
        tracking_limit=tracking_limit,
    )


def load_score(reward: str, context: CriterionContext) -> ScoreFn:
    """The score named by a criterion or by the directory of a learned reward.

    Raises:
        GaitprefError: it is none of these, or cannot be used.
    """
    if Path(reward).is_dir():
        return load_reward(Path(reward))
    return score_of_criterion(load_criterion(reward, context))
