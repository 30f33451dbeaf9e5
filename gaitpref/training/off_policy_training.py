"""A training as the off-policy learner does it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from policy.training.ppo import PpoCfg, ScoreFn
from policy.training.train_cfg import TrainCfg

from .total_reward import TotalReward

_STEPS_PER_ITERATION = 512
"""Environment steps after which figures are written, about."""
_SAVE_EVERY = 100
"""Iterations between two states; each holds all of memory."""


def paid_by_step(reward: ScoreFn | None, tell: Callable[[str], None]) -> ScoreFn | None:
    """`reward` without the price of following commands worse: it looks at a rollout as
    a whole, and what is remembered is none. `tell` gets a line where there was one."""
    if not isinstance(reward, TotalReward) or reward.tracking_limit is None:
        return reward
    tell(
        "following commands worse costs nothing more here: its price is one of whole "
        "rollouts, and off-policy each remembered step is paid for itself"
    )
    return replace(reward, tracking_limit=None)


def off_policy_cfg(cfg: TrainCfg) -> TrainCfg:
    """`cfg` in short iterations with rare states.

    Of PPO's settings the number of environments, the sizes of the policy and the mirror
    are kept, and what the learner refuses.
    """
    ppo = PpoCfg(
        num_envs=cfg.ppo.num_envs,
        steps_per_env=max(1, _STEPS_PER_ITERATION // cfg.ppo.num_envs),
        hidden_sizes=cfg.ppo.hidden_sizes,
        mirror=cfg.ppo.mirror,
        bonus=cfg.ppo.bonus,
        kl_penalty=cfg.ppo.kl_penalty,
    )
    return replace(cfg, ppo=ppo, save_every=_SAVE_EVERY)
