"""A robot from scratch that stands still, and what it is trained on to get it going.

What comes of that is not judged beside the policy before: it is there to be seen.

Shapes: T steps, N episodes, F feature columns.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from data.features import column
from data.files.files import write_atomically
from gaitpref.method.context import RoundContext
from gaitpref.method.unstick import Optimism
from policy.rollouts.evaluate import rollout_features
from policy.training.checkpoint import Policy, load_policy
from rewardmodel.models.model import RewardModel
from rewardmodel.paid.optimism import OptimisticReward

from .loop_cfg import LoopCfg
from .run_dir import STANDSTILL_NAME, Round, approved, seed_of

_EPISODES = 16


@dataclass(frozen=True, kw_only=True)
class Standstill:
    """A policy that goes nowhere, and what it does."""

    speed_m_s: float
    """Mean planar speed over the grid of commands, without noise."""
    told_m_s: float
    """Mean speed that the commands ask for."""
    features: Tensor
    """[T, N, F] of its episodes."""
    lengths: Tensor
    """[N] of its episodes."""

    def __str__(self) -> str:
        return f"{self.speed_m_s:.2f} m/s where told {self.told_m_s:.2f}"

    def reward(self, model: RewardModel, optimism: Optimism) -> OptimisticReward:
        """What `model` pays who hopes for something better."""
        return OptimisticReward.leaving(
            model, self.features, self.lengths, optimism.deviations
        )

    def save(self, folder: Path) -> None:
        """Leave word beside the policy that was trained to leave it."""
        found = {"speed_m_s": self.speed_m_s, "told_m_s": self.told_m_s}
        write_atomically(folder / STANDSTILL_NAME, json.dumps(found).encode())


def standstill_before(
    cfg: LoopCfg, round: Round, context: RoundContext
) -> Standstill | None:
    """The policy a round begins from, if it stands still and the round is to leave
    it."""
    optimism = cfg.method.unstick
    if optimism is None or not optimism.looks(context):
        return None
    policy = load_policy(approved(round.before))
    return standing_of(policy, optimism, seed=seed_of(cfg, round.number, 12))


def standing_of(policy: Policy, optimism: Optimism, *, seed: int) -> Standstill | None:
    """What `policy` does where it is told to go, if that is to stand still."""
    features, lengths = rollout_features(
        policy, policy.robot(), policy.info.env, episodes=_EPISODES, seed=seed
    )
    return seen_standing(features, lengths, still=optimism.still)


def seen_standing(
    features: Tensor, lengths: Tensor, *, still: float
) -> Standstill | None:
    """What rows [T, N, F] of episodes with `lengths` [N] show, if that is a robot whose
    speed is below a share `still` of what it is told."""
    rows = features[torch.arange(len(features))[:, None] < lengths]
    speed, told = (
        float(rows[:, column(name)][:, :2].norm(dim=1).mean())
        for name in ("base_lin_vel_b", "command")
    )
    if not speed < still * told:
        return None
    return Standstill(
        speed_m_s=speed, told_m_s=told, features=features, lengths=lengths
    )
