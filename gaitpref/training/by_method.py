"""What the method's decisions are to recording and to training.

The loop and the commands that do a stage of it by hand go through here, so that both
make the same.

Shapes: T steps, N episodes, F feature columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from data.datasets.dataset import Dataset
from gaitpref.method.clip_sources import ClipSources
from gaitpref.method.context import RoundContext
from gaitpref.method.exploration import Noise, pays_for_rate
from gaitpref.method.method import Method
from policy.robots.robot import Robot
from policy.rollouts.record_cfg import RecordCfg
from policy.rollouts.variation import VariationCfg
from policy.training.checkpoint import Policy
from policy.training.ppo import ScoreFn
from policy.training.train_cfg import TrainCfg
from rewardmodel.models.model import RewardModel

from .symmetry import in_mirror
from .total_reward import TotalReward, total_reward
from .tracking_limit import limit_beside

_EPISODES_LOOKED_AT = 32
"""Recorded episodes that show whether a reward tells left from right."""


def recorded_by(clips: ClipSources, record: RecordCfg) -> RecordCfg:
    """`record` with the shares of `clips` in it."""
    return replace(
        record,
        noisy_share=clips.noisy_share,
        babble_share=clips.rhythm_share,
        variation=VariationCfg(share=clips.posture_share),
    )


def with_noise(cfg: TrainCfg, noise: Noise) -> TrainCfg:
    """`cfg` with the noise of one training."""
    return replace(
        cfg,
        exploration_std=noise.start_std,
        final_std=noise.final_std,
        calm_from=noise.calm_from,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Retraining:
    """What a method has to know to say how a policy is retrained."""

    method: Method
    context: RoundContext
    robot: Robot
    model: RewardModel
    """The learned reward."""
    seen: Tensor
    """[T, N, F] of episodes, on which to see whether it tells left from right."""
    start: Policy
    """The policy it begins from."""
    base: Policy | None
    """The walking policy whose task reward is kept; None from scratch."""

    def trained(self, cfg: TrainCfg) -> TrainCfg:
        """`cfg` with what the method decides of the algorithm."""
        if self.method.mirror:
            ppo = in_mirror(cfg.ppo, self.robot, self.model, self.seen)
            cfg = replace(cfg, ppo=ppo)
        if self.method.exploration is None or self.method.learner is not None:
            return cfg
        noise = self.method.exploration.noise(
            self.context,
            policy_std=float(self.start.std.mean()),
            pays_for_rate=pays_for_rate(self.model),
        )
        return with_noise(cfg, noise)

    def reward(self, learned: ScoreFn, cfg: TrainCfg) -> TotalReward:
        """What is paid: `learned`, the known terms, and the task where it is kept."""
        tracking = self.method.tracking
        limit = None
        if self.base is not None and tracking is not None:
            # One seed for all rounds, so that they cannot each add to the last's error.
            limit = limit_beside(self.base, tracking, seed=0)
        return total_reward(
            learned,
            self.robot,
            cfg.env,
            known=self.method.safety,
            weight=self.method.weight,
            keep_task=self.base is not None,
            tracking_limit=limit,
        )


def rows_of(dataset: Dataset, episodes: Sequence[str]) -> Tensor:
    """Rows [T, N, F] of some of `episodes`, as long as the shortest; those that are
    gone are left out."""
    names = [name for name in episodes if dataset.holds(name)]
    some = names[:: max(1, len(names) // _EPISODES_LOOKED_AT)]
    rows = [torch.tensor(dataset.features(name)) for name in some]
    shortest = min(len(each) for each in rows)
    return torch.stack([each[:shortest] for each in rows], dim=1)
