"""A style must not cost the walk: its reward yields where commands are followed worse.

Shapes: T steps of a rollout, N environments, F feature columns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from data.features import column
from policy.checkpoint import Policy
from policy.evaluate import rollout_features

SHARPNESS = 5.0
"""A fifth beyond the limit, the style counts 1/e of what it does within it."""
_EPISODES = 32


def tracking_error(features: Tensor) -> Tensor:
    """Planar distance [...] in m/s of velocity and command, of rows [..., F]."""
    velocity = features[..., column("base_lin_vel_b")][..., :2]
    return (velocity - features[..., column("command")][..., :2]).norm(dim=-1)


@dataclass(frozen=True, kw_only=True)
class TrackingLimit:
    """How badly commands may be followed before a style is worth less."""

    error_m_s: float
    """Mean planar error of a rollout that is still fine, exploration noise included."""

    def share(self, features: Tensor) -> float:
        """Share of the style's reward that is left for a rollout [T, N, F], in (0, 1].

        One number a rollout: it changes slowly, and no step is worth less for being the
        first after a start.
        """
        excess = float(tracking_error(features).mean()) / self.error_m_s - 1.0
        return math.exp(-SHARPNESS * max(0.0, excess))


def limit_beside(base: Policy, *, slack_m_s: float, seed: int) -> TrackingLimit:
    """`slack_m_s` more than `base` errs with its own exploration noise."""
    rng = torch.Generator().manual_seed(seed)

    def noisy(obs: Tensor, noise: Tensor | None = None) -> Tensor:
        return base(obs, torch.randn(len(obs), 12, generator=rng))

    rows, lengths = rollout_features(
        noisy, base.robot(), base.info.env, episodes=_EPISODES, seed=seed
    )
    there = torch.arange(len(rows))[:, None] < lengths
    return TrackingLimit(
        error_m_s=float(tracking_error(rows)[there].mean()) + slack_m_s
    )
