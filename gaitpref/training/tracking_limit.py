"""A style must not cost the walk: where commands are followed worse, following them is
worth more, and the style less.

The task's own terms are nearly flat at small errors, so they do not hold what a style
gives up bit by bit. Beyond a limit every step therefore pays for its error, at a price
that grows with the excess (a Lagrange multiplier that follows the constraint at once;
Stooke et al. 2020, "Responsive Safety in Reinforcement Learning by PID Lagrangian
Methods", with its proportional part alone, which needs no memory).

Shapes: T steps of a rollout, N environments, F feature columns.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import torch
from torch import Tensor

from data.features import column
from gaitpref.method.tracking import TrackingPrice
from policy.env.env import QuadrupedEnv
from policy.rollouts.rollout import first_episodes
from policy.training.checkpoint import Policy

_EPISODES = 64

Mean = Callable[[Tensor], Tensor]
"""Mean over a rollout: over those of all ranks, where several train."""


def tracking_error(features: Tensor) -> Tensor:
    """Planar distance [...] in m/s of velocity and command, of rows [..., F]."""
    velocity = features[..., column("base_lin_vel_b")][..., :2]
    return (velocity - features[..., column("command")][..., :2]).norm(dim=-1)


@dataclass(frozen=True, kw_only=True)
class TrackingLimit:
    """How badly commands may be followed before a style is worth less."""

    error_m_s: float
    """Mean planar error of a rollout that is still fine, exploration noise included."""
    price: TrackingPrice = field(default_factory=TrackingPrice)
    """What more costs."""

    def excess(self, features: Tensor, mean: Mean = torch.mean) -> float:
        """How far, as a share of the limit, the mean error of a rollout [T, N, F] is
        beyond it; 0 within.

        One number a rollout: it changes slowly, and no step is worth less for being the
        first after a start.
        """
        error_m_s = float(mean(tracking_error(features)))
        return max(0.0, error_m_s / self.error_m_s - 1.0)

    def share(self, features: Tensor, mean: Mean = torch.mean) -> float:
        """Share of the style's reward left for a rollout [T, N, F], in (0, 1]."""
        return math.exp(-self.price.sharpness * self.excess(features, mean))

    def cost(self, features: Tensor, mean: Mean = torch.mean) -> Tensor:
        """What the errors of a rollout [T, N, F] cost, per second, [T, N].

        It sums to nothing: a step is paid for missing its command by less than others
        do, and walking on is worth what it was.
        """
        error = tracking_error(features)
        due = min(1.0, self.excess(features, mean) / self.price.full_price_at)
        return self.price.price * due * (error - mean(error))


def limit_beside(base: Policy, price: TrackingPrice, *, seed: int) -> TrackingLimit:
    """The limit for a style on top of `base`: some slack more than this errs without
    noise, at commands that change as they do in training."""
    env = QuadrupedEnv(base.robot(), base.info.env, _EPISODES, seed=seed)
    total, steps = 0.0, 0.0
    for step in first_episodes(base, env):
        counts = step.alive & ~step.aborted
        total += float(tracking_error(step.features)[counts].sum())
        steps += float(counts.sum())
    return TrackingLimit(error_m_s=total / steps + price.slack_m_s, price=price)
