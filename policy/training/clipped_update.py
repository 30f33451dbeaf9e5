"""RSL-RL's clipped update with actor and critic in a thread each.

Its loss is a sum of what concerns the actor alone and what concerns the critic alone,
and the networks share no weight. Taken apart, each gets the same gradients to the last
bit, whatever the number of cores; with two of them an update takes about three quarters
of the time (docs/benchmarks.md).

Shapes: B steps of a minibatch.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial

import torch
from rsl_rl.algorithms import PPO
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict
from torch import Tensor, nn

from policy.parallel.ranks import ALONE, Ranks

from .mirror import Mirror

Batch = RolloutStorage.Batch

LEAST_RATE, _HIGHEST_RATE = 1e-5, 1e-2
"""Bounds of the adapted learning rate, those of RSL-RL."""


def clipped_update(
    alg: PPO,
    mirror: Mirror | None = None,
    ranks: Ranks = ALONE,
    *,
    actor: bool = True,
) -> dict[str, float]:
    """Run all epochs over the stored rollout; mean losses by name.

    For feed-forward networks without RSL-RL's extensions; others need its own update.

    Args:
        mirror: Learn from every step in the mirror too.
        ranks: Who takes the same steps, each on a rollout of its own.
        actor: Change the actor as well, and not the critic alone.
    """
    # Every epoch takes the same minibatches, so they are gathered once.
    batches = list(alg.storage.mini_batch_generator(alg.num_mini_batches, 1))
    if mirror is not None:
        batches = [_with_mirrored(batch, mirror) for batch in batches]
    sums = torch.zeros(3, dtype=torch.float64, device=alg.device)
    none = torch.zeros(2, device=alg.device)
    with _beside(alg) as beside:
        for batch in batches * alg.num_learning_epochs:
            alg.optimizer.zero_grad()
            critic = beside(_critic_gradients, alg, batch)
            surrogate, entropy, kl = *none, None
            if actor:
                surrogate, entropy, kl = _actor_gradients(alg, batch)
            sums += torch.stack([critic(), surrogate, entropy])
            _step(alg, kl, ranks)
    obs = alg.storage.observations.flatten(0, 1)
    alg.actor.update_normalization(obs)
    alg.critic.update_normalization(obs)
    alg.storage.clear()
    means = (sums / (len(batches) * alg.num_learning_epochs)).tolist()
    return dict(zip(("value", "surrogate", "entropy"), means, strict=True))


_Beside = Callable[..., Callable[[], Tensor]]


@contextmanager
def _beside(alg: PPO) -> Iterator[_Beside]:
    """Gives a way to start a function, and of what it gives to wait for it: in a thread
    of its own on a CPU; a GPU works through one queue."""
    if torch.device(alg.device).type != "cpu":
        yield lambda function, *arguments: partial(function, *arguments)
        return
    threads = torch.get_num_threads()
    with ThreadPoolExecutor(1, "critic", torch.set_num_threads, (threads,)) as pool:
        yield lambda function, *arguments: pool.submit(function, *arguments).result


def _with_mirrored(batch: Batch, mirror: Mirror) -> Batch:
    """`batch` and behind it the same steps in the mirror, as likely and as good."""
    assert batch.observations is not None
    assert batch.actions is not None
    obs = batch.observations["policy"]
    both = torch.cat([obs, mirror.obs(obs)])
    return RolloutStorage.Batch(
        observations=TensorDict({"policy": both}, batch_size=[len(both)]),
        actions=torch.cat([batch.actions, mirror.action(batch.actions)]),
        values=_twice(batch.values),
        advantages=_twice(batch.advantages),
        returns=_twice(batch.returns),
        old_actions_log_prob=_twice(batch.old_actions_log_prob),
        old_distribution_params=batch.old_distribution_params,
    )


def _twice(values: Tensor | None) -> Tensor:
    assert values is not None
    return torch.cat([values, values])


def _actor_gradients(alg: PPO, batch: Batch) -> tuple[Tensor, Tensor, Tensor]:
    """Set the actor's gradients; surrogate loss, entropy, and the KL from the policy
    that acted."""
    assert batch.actions is not None
    assert batch.old_distribution_params is not None
    alg.actor(batch.observations, stochastic_output=True)
    log_prob = alg.actor.get_output_log_prob(batch.actions)
    entropy = alg.actor.output_entropy.mean()
    with torch.no_grad():
        # What is mirrored follows what was done.
        old = batch.old_distribution_params
        new = tuple(p[: len(old[0])] for p in alg.actor.output_distribution_params)
        kl = alg.actor.get_kl_divergence(old, new).mean()
    gain = -_flat(batch.advantages)
    ratio = torch.exp(log_prob - _flat(batch.old_actions_log_prob))
    clipped = ratio.clamp(1.0 - alg.clip_param, 1.0 + alg.clip_param)
    surrogate = torch.max(gain * ratio, gain * clipped).mean()
    (surrogate - alg.entropy_coef * entropy).backward()
    return surrogate.detach(), entropy.detach(), kl


def _critic_gradients(alg: PPO, batch: Batch) -> Tensor:
    """Set the critic's gradients; its loss."""
    assert batch.values is not None
    assert batch.returns is not None
    values = alg.critic(batch.observations)
    losses = (values - batch.returns).pow(2)
    if alg.use_clipped_value_loss:
        change = (values - batch.values).clamp(-alg.clip_param, alg.clip_param)
        losses = torch.max(losses, (batch.values + change - batch.returns).pow(2))
    loss = losses.mean()
    (alg.value_loss_coef * loss).backward()
    return loss.detach()


def _step(alg: PPO, kl: Tensor | None, ranks: Ranks) -> None:
    """Step both networks along what all ranks found, as far as their KL allows; None
    where the actor stays as it is."""
    networks = (alg.actor, alg.critic)
    found = [p.grad for network in networks for p in network.parameters()]
    averaged = [each for each in (kl, *found) if each is not None]
    ranks.average(averaged)
    if kl is not None and alg.desired_kl is not None and alg.schedule == "adaptive":
        _adapt_rate(alg, float(kl), alg.desired_kl)
    for network in networks:
        nn.utils.clip_grad_norm_(network.parameters(), alg.max_grad_norm)
    alg.optimizer.step()


def _adapt_rate(alg: PPO, kl: float, desired: float) -> None:
    """A smaller step where the last one moved the policy too far, and vice versa."""
    if kl > 2.0 * desired:
        alg.learning_rate = max(LEAST_RATE, alg.learning_rate / 1.5)
    elif 0.0 < kl < desired / 2.0:
        alg.learning_rate = min(_HIGHEST_RATE, alg.learning_rate * 1.5)
    for group in alg.optimizer.param_groups:
        group["lr"] = alg.learning_rate


def _flat(column: Tensor | None) -> Tensor:
    """[B] of [B, 1]."""
    assert column is not None
    return column[:, 0]
