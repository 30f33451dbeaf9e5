"""How much exploration noise a round's training has, and whether it comes down.

Noise makes feet chatter on the ground. Where the rate of steps is paid for, a policy is
then paid for what is gone without noise, so that noise has to come down before it is
done; elsewhere that costs more than it gives, as less noise learns more slowly.
"""

from __future__ import annotations

from dataclasses import replace

from policy.checkpoint import Policy
from policy.train import TrainCfg
from rewardmodel.model import RewardModel
from rewardmodel.sparse import SparseScorer

from .loop_cfg import LoopCfg

_MUCH = 0.25
"""Of what the most important habit makes of a reward, from which on another counts."""
_GONE = 1.5
"""Times `LoopCfg.calm_std` up to which a policy's noise has come down."""


def with_noise(
    cfg: LoopCfg, round: int, train_cfg: TrainCfg, model: RewardModel, start: Policy
) -> TrainCfg:
    """`train_cfg` with the noise of the training of `round`, counted from 1.

    Args:
        cfg: The loop.
        round: Which retraining.
        train_cfg: Its training otherwise.
        model: The reward it is paid.
        start: The policy it begins from.
    """
    if cfg.exploration is not None:
        last = round == cfg.rounds
        return replace(
            train_cfg,
            exploration_std=cfg.exploration.std(round, cfg.rounds),
            final_std=cfg.exploration.final if last else None,
        )
    std = cfg.noise_back if round == 1 else cfg.noise_again
    train_cfg = put_back(cfg, train_cfg, start, std=std)
    if cfg.calm_std is None or not pays_for_rate(model):
        return train_cfg
    return replace(train_cfg, final_std=cfg.calm_std, calm_from=cfg.calm_from)


def put_back(
    cfg: LoopCfg, train_cfg: TrainCfg, start: Policy, *, std: float
) -> TrainCfg:
    """`train_cfg` with noise of `std` where `start`, which it begins from, has little
    left."""
    if cfg.calm_std is None or float(start.std.mean()) >= _GONE * cfg.calm_std:
        return train_cfg
    return replace(train_cfg, exploration_std=std)


def pays_for_rate(model: RewardModel) -> bool:
    """Whether the rate of steps is among the few things a sum of curves is about."""
    if not isinstance(payer := model.payer, SparseScorer):
        return False
    heights = payer.heights
    return bool(heights[-1] > 0 and heights[-1] >= _MUCH * heights.max())
