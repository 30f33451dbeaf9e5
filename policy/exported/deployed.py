"""A policy up to the joint targets, as the network that is written into a file.

Shapes: N observations at once.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from policy.law.law import Law
from policy.networks.recipe import RecipeNetwork
from policy.networks.settled import settled
from policy.training.checkpoint import Policy

_UNBOUNDED_RAD = 1e6
"""Bound of targets that have none: infinity is in no file of ours."""


class _ToJoints(nn.Module):
    """The network of a policy, and what the environment does with what it acts."""

    def __init__(self, policy: Policy, law: Law) -> None:
        super().__init__()
        network = policy.network
        if isinstance(network, RecipeNetwork):
            # One that was brought in by an earlier version may compute its shapes.
            network = settled(network)
        self.network = network
        self.action_limit = law.action_limit
        self.order: Tensor
        self.scale_rad: Tensor
        self.offset: Tensor
        self.low: Tensor
        self.high: Tensor
        bounds = law.target_clip_rad or ((-_UNBOUNDED_RAD, _UNBOUNDED_RAD),) * 12
        low, high = np.array(bounds).T
        self.register_buffer("order", torch.from_numpy(law.from_canonical))
        self.register_buffer("scale_rad", _float32(np.array(law.action_scale_rad)))
        self.register_buffer("offset", _float32(np.array(law.action_offset_rad)))
        self.register_buffer("low", _float32(low))
        self.register_buffer("high", _float32(high))

    def moved(self, acted: Tensor) -> tuple[Tensor, Tensor]:
        """Actions [N, 12] and joint targets [N, 12], rad."""
        action = acted.index_select(1, self.order)
        action = action.clamp(-self.action_limit, self.action_limit)
        target = self.offset + self.scale_rad * action
        return action, torch.minimum(torch.maximum(target, self.low), self.high)


class Deployed(_ToJoints):
    """A policy, up to the joints."""

    def forward(self, obs: Tensor) -> tuple[Tensor, Tensor]:
        """Actions and joint targets of `obs` [N, D]."""
        return self.moved(self.network(obs))


class DeployedGaits(_ToJoints):
    """One that chooses among gaits, and is told what it remembers."""

    def forward(self, obs: Tensor, gait: Tensor, steps: Tensor) -> tuple[Tensor, ...]:
        """The same of `obs` [N, D], and the memory [N] and [N] of the next step."""
        acted, *memory = self.network(obs, gait, steps)
        return *self.moved(acted), *memory


def _float32(values: np.ndarray) -> Tensor:
    return torch.tensor(values.astype(np.float32))
