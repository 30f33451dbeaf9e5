"""The actor: a Gaussian through tanh, within what the joints can do.

An action is `bound * tanh(u)`. A tanh alone ends at 1, where an environment may expect
more: the robot then cannot do what the reward asks for, and nothing says so. So the
bound is that of the environment's actions, for each joint no more than reaches the
farther end of its range.

Shapes: N observations, D numbers of one.
"""

from __future__ import annotations

import math
from itertools import pairwise

import torch
from rsl_rl.modules import EmpiricalNormalization
from torch import Tensor, nn

from policy.env.env import QuadrupedEnv

from .sac_cfg import SacCfg

_EPS = 1e-2
"""What keeps a number that never changes from being blown up."""


class TanhActor(nn.Module):
    """Observations [N, D] to actions [N, 12] and how likely they are."""

    def __init__(
        self,
        obs_dim: int,
        sizes: tuple[int, ...],
        bound: Tensor,
        *,
        first_std: float,
        std_bounds: tuple[float, float],
    ) -> None:
        """Make it, acting close to the home pose.

        Args:
            obs_dim: Numbers of an observation.
            sizes: Widths of the hidden layers.
            bound: [12] the largest action of each joint.
            first_std: Noise at the start, in units of the action.
            std_bounds: Least and most noise of a state, in the same units.
        """
        super().__init__()
        self.normalizer = EmpiricalNormalization(obs_dim, eps=_EPS)
        widths = (obs_dim, *sizes)
        self.hidden = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(widths))
        self.mean = nn.Linear(widths[-1], 12)
        self.log_std = nn.Linear(widths[-1], 12)
        self.bound: Tensor
        self.register_buffer("bound", bound.clone())
        self._log_bounds = tuple(math.log(std) for std in std_bounds)
        with torch.no_grad():
            self.mean.weight.mul_(0.1)
            self.mean.bias.zero_()
            self.log_std.weight.mul_(0.1)
        self.begin_with_std(first_std)

    @torch.no_grad()
    def begin_with_std(self, std: float) -> None:
        """Set the noise of a network that has not learned it, in units of the
        action."""
        low, high = self._log_bounds
        share = (math.log(std) - low) / (high - low)
        share = min(max(share, 1e-3), 1.0 - 1e-3)
        self.log_std.bias.fill_(math.log(share / (1.0 - share)))

    @property
    def obs_mean(self) -> Tensor:
        """[D] what observations were on average."""
        return self.normalizer.get_buffer("_mean")[0]

    @property
    def obs_spread(self) -> Tensor:
        """[D] what they are divided by once that is taken off."""
        return self.normalizer.get_buffer("_std")[0] + _EPS

    def parts(self, obs: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and standard deviation [N, 12] before tanh; 1 is about the bound."""
        x = self.normalizer(obs)
        for layer in self.hidden:
            x = nn.functional.elu(layer(x))
        low, high = self._log_bounds
        log_std = low + (high - low) * self.log_std(x).sigmoid()
        return self.mean(x), log_std.exp() / self.bound

    def forward(self, obs: Tensor) -> Tensor:
        """Actions [N, 12] without noise."""
        return self.bound * self.parts(obs)[0].tanh()

    def sample(self, obs: Tensor) -> tuple[Tensor, Tensor]:
        """Actions [N, 12] from PyTorch's chance, and the logarithm [N] of their
        density, in nats of actions whose bound is 1."""
        mean, std = self.parts(obs)
        noise = torch.randn_like(mean)
        u = mean + std * noise
        gauss = -0.5 * noise.square() - std.log() - 0.5 * math.log(2.0 * math.pi)
        # log(1 - tanh(u)^2), which is exact where tanh has become 1.
        slope = 2.0 * (math.log(2.0) - u - nn.functional.softplus(-2.0 * u))
        return self.bound * u.tanh(), (gauss - slope).sum(dim=-1)

    @torch.no_grad()
    def action_std(self, obs: Tensor) -> Tensor:
        """[12] noise of the actions over `obs`, in their unit, to first order."""
        mean, std = self.parts(obs)
        return (self.bound * std * (1.0 - mean.tanh().square())).mean(dim=0)


def action_bound(env: QuadrupedEnv, most_action: float) -> Tensor:
    """[12] the largest useful action of each joint, either way.

    It is the environment's limit, or `most_action`, or what reaches the farther end of
    the joint's range.
    """
    most = min(env.cfg.action_limit, most_action)
    return env.reach().clamp(max=most)


def new_actor(
    cfg: SacCfg, obs_dim: int, bound: Tensor, sizes: tuple[int, ...]
) -> TanhActor:
    """One that has learned nothing."""
    return TanhActor(
        obs_dim,
        sizes,
        bound,
        first_std=cfg.first_std,
        std_bounds=cfg.std_bounds,
    )
