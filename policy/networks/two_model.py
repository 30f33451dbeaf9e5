"""A network for each robot of a team in the place of one, so that PPO trains both.

Batches are shuffled, so what tells the robots apart is in the observation: its last
number is 0 for the first and 1 for the second. No network sees it.

Shapes: N observations of D numbers and which robot, A outputs.
"""

from __future__ import annotations

from typing import Any

import torch
from rsl_rl.modules import MLP, EmpiricalNormalization
from tensordict import TensorDict
from torch import Tensor, nn
from torch.distributions import Normal

from data.errors import GaitprefError

ROBOTS = 2
_LEAST_STD = 1e-6


def second(obs: Tensor) -> Tensor:
    """[N] bool, which of observations [N, D + 1] are of the second robot."""
    return obs[:, -1] > 0.5


class _Own(nn.Module):
    """The network of one robot."""

    def __init__(
        self, obs_dim: int, output_dim: int, hidden_dims: list[int], activation: str
    ) -> None:
        super().__init__()
        self.obs_normalizer = EmpiricalNormalization(obs_dim)
        self.mlp = MLP(obs_dim, output_dim, hidden_dims, activation)

    def forward(self, obs: Tensor) -> Tensor:
        """Outputs [N, A] of `obs` [N, D]."""
        return self.mlp(self.obs_normalizer(obs))


class _Noise(nn.Module):
    """Exploration noise of both."""

    def __init__(self, output_dim: int, init_std: float) -> None:
        super().__init__()
        self.std_param = nn.Parameter(torch.full((ROBOTS, output_dim), init_std))


class TwoModel(nn.Module):
    """Stands for RSL-RL's actor, or its critic, of a team with two policies."""

    is_recurrent = False

    def __init__(
        self,
        obs: TensorDict,
        obs_groups: dict[str, list[str]],
        obs_set: str,
        output_dim: int,
        *,
        hidden_dims: list[int],
        activation: str,
        obs_normalization: bool = True,
        distribution_cfg: dict[str, Any] | None = None,
    ) -> None:
        """As RSL-RL makes its own; a critic has no distribution, and all are
        normalised."""
        super().__init__()
        (self._group,) = obs_groups[obs_set]
        self._outputs = output_dim
        obs_dim = obs[self._group].shape[-1] - 1
        self.robots = nn.ModuleList(
            _Own(obs_dim, output_dim, list(hidden_dims), activation)
            for _ in range(ROBOTS)
        )
        self.distribution: _Noise | None = None
        if distribution_cfg is not None:
            self.distribution = _Noise(output_dim, distribution_cfg["init_std"])
        self._acts: Normal | None = None

    def forward(
        self,
        obs: TensorDict,
        masks: Tensor | None = None,
        hidden_state: None = None,
        stochastic_output: bool = False,
    ) -> Tensor:
        """Outputs [N, A], each row of its own robot's network."""
        rows = obs[self._group]
        whose = second(rows)
        mean = rows.new_zeros(len(rows), self._outputs)
        for network, own in zip(self.robots, (~whose, whose), strict=True):
            mean[own] = network(rows[own, :-1])
        if self.distribution is None or not stochastic_output:
            return mean
        self._acts = Normal(mean, self.std_of(rows), validate_args=False)
        return self._acts.sample()

    def std_of(self, obs: Tensor) -> Tensor:
        """Exploration noise [N, A] of the robots of `obs` [N, D + 1]."""
        assert self.distribution is not None
        return self.distribution.std_param.clamp(min=_LEAST_STD)[second(obs).long()]

    def update_normalization(self, obs: TensorDict) -> None:
        """Let each network see what its robot sees."""
        rows = obs[self._group]
        whose = second(rows)
        for network, own in zip(self.robots, (~whose, whose), strict=True):
            network.obs_normalizer.update(rows[own, :-1])  # type: ignore[operator]

    @property
    def _acting(self) -> Normal:
        assert self._acts is not None
        return self._acts

    @property
    def output_std(self) -> Tensor:
        """[N, A]"""
        return self._acting.stddev

    @property
    def output_entropy(self) -> Tensor:
        """[N]"""
        return self._acting.entropy().sum(dim=-1)

    @property
    def output_distribution_params(self) -> tuple[Tensor, ...]:
        """Means and deviations, [N, A] each."""
        return self._acting.mean, self._acting.stddev

    def get_output_log_prob(self, outputs: Tensor) -> Tensor:
        """[N] of `outputs` [N, A]."""
        return self._acting.log_prob(outputs).sum(dim=-1)

    def get_kl_divergence(
        self, old: tuple[Tensor, ...], new: tuple[Tensor, ...]
    ) -> Tensor:
        """[N] nats from the new to the old."""
        both = (Normal(*params, validate_args=False) for params in (old, new))
        return torch.distributions.kl_divergence(*both).sum(dim=-1)

    def reset(self, dones: Tensor | None = None, hidden_state: None = None) -> None:
        """Nothing is remembered."""

    def get_hidden_state(self) -> None:
        """None: nothing is remembered."""

    def detach_hidden_state(self, dones: Tensor | None = None) -> None:
        """Nothing is remembered."""

    def as_jit(self) -> nn.Module:
        """
        Raises:
            GaitprefError: always; a robot alone has one network.
        """
        raise GaitprefError(
            "this policy holds a network for each robot of a team: no file of a robot "
            "alone says what both do"
        )


def of_both(state: dict[str, Any]) -> dict[str, Any]:
    """The state of a `TwoModel` whose robots both do what the network of `state`
    does."""
    found: dict[str, Any] = {}
    for name, value in state.items():
        if name.startswith("distribution."):
            found[name] = torch.stack([value] * ROBOTS)
        else:
            for robot in range(ROBOTS):
                copied = value.clone() if isinstance(value, Tensor) else value
                found[f"robots.{robot}.{name}"] = copied
    return found
