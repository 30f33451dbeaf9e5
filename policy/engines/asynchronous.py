"""Gradients that actors compute themselves, taken as they come (A3C).

Mnih et al. 2016 (arXiv 1602.01783): the learner takes a step along each gradient that
arrives, whatever the weights have become meanwhile; nothing corrects for that. The
advantage is that of GAE, and Adam stands for shared RMSProp.

Shapes: B steps of a rollout, O observed numbers.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from rsl_rl.models import MLPModel
from tensordict import TensorDict
from torch import Tensor, nn

from policy.training.ppo import RewardPpo

Moments = tuple[int, np.ndarray, np.ndarray]
"""How many there were of what was observed, mean [O] and variance [O]."""


def gradients_of(
    alg: RewardPpo,
) -> tuple[list[np.ndarray], list[np.ndarray], dict[str, float]]:
    """What the rollout in `alg`'s storage says of actor and critic, each gradient cut
    to the norm `alg` allows, and the losses by TensorBoard tag."""
    storage = alg.storage
    obs = storage.observations.flatten(0, 1).clone()
    advantages = storage.advantages.flatten(0, 1)[:, 0].clone()
    returns = storage.returns.flatten(0, 1).clone()
    alg.actor(obs, stochastic_output=True)
    log_prob = alg.actor.get_output_log_prob(storage.actions.flatten(0, 1).clone())
    entropy = alg.actor.output_entropy.mean()
    surrogate = -(log_prob * advantages).mean()
    error = (alg.critic(obs) - returns).square().mean()
    found = (
        _gradients(alg.actor, surrogate - alg.entropy_coef * entropy, alg),
        _gradients(alg.critic, alg.value_loss_coef * error, alg),
    )
    losses = {"value": error, "surrogate": surrogate, "entropy": entropy}
    return *found, {f"loss/{k}": float(loss.detach()) for k, loss in losses.items()}


def _gradients(network: nn.Module, loss: Tensor, alg: RewardPpo) -> list[np.ndarray]:
    network.zero_grad()
    loss.backward()
    nn.utils.clip_grad_norm_(network.parameters(), alg.max_grad_norm)
    return [p.grad.numpy().copy() for p in network.parameters() if p.grad is not None]


def apply_gradients(
    alg: RewardPpo, actor: Sequence[np.ndarray], critic: Sequence[np.ndarray]
) -> None:
    """Take a step along gradients of both networks."""
    for network, found in ((alg.actor, actor), (alg.critic, critic)):
        for parameter, gradient in zip(network.parameters(), found, strict=True):
            parameter.grad = torch.tensor(gradient)
    alg.optimizer.step()


def moments_of(network: MLPModel, obs: TensorDict) -> Moments:
    """What `network` saw of the observations `obs` of B steps."""
    seen = torch.cat([obs[group] for group in network.obs_groups], dim=-1)
    mean, var = seen.mean(dim=0), seen.var(dim=0, unbiased=False)
    return len(seen), mean.numpy(), var.numpy()


def absorb(network: MLPModel, moments: Moments) -> None:
    """Let the normaliser of `network` count observations it did not see.

    As RSL-RL's own does with those it sees (Chan et al. 1979, updating formulae).
    """
    # These share their memory with the normaliser's own.
    own = network.obs_normalizer.state_dict()
    count, mean, var = moments[0], *map(torch.tensor, moments[1:])
    own["count"] += count
    rate = count / own["count"]
    change = mean - own["_mean"]
    own["_mean"] += rate * change
    own["_var"] += rate * (var - own["_var"] + change * (mean - own["_mean"]))
    own["_std"].copy_(own["_var"].sqrt())
