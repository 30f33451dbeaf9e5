"""V-trace: what rollouts of an older policy say about the present one.

Espeholt et al. 2018, "IMPALA" (arXiv 1802.01561), equation 1, with the factor lambda of
its remark 2 in the traces, and the policy gradient of its section 4.2.

Shapes: T steps of a rollout, N environments.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True, kw_only=True)
class VTraceCfg:
    """How far the probabilities of two policies may correct a rollout."""

    rho_bar: float = 1.0
    """The most a step counts: it decides which policy's values are learned."""
    c_bar: float = 1.0
    """The most a step passes on of what came after it: it decides how fast."""

    def __post_init__(self) -> None:
        if not 0.0 < self.c_bar <= self.rho_bar:
            raise ValueError(
                f"0 < c_bar <= rho_bar must hold, got {self.c_bar} and {self.rho_bar}"
            )


@dataclass(frozen=True, eq=False)
class Corrected:
    """What a rollout teaches."""

    targets: Tensor
    """[T, N] what the values should be."""
    advantages: Tensor
    """[T, N] how much better an action was than the policy's mean, times how much it
    counts."""
    clipped: Tensor
    """[T, N] 1 where a step would have counted more than it may, else 0."""


def vtrace(
    rewards: Tensor,
    values: Tensor,
    last_values: Tensor,
    dones: Tensor,
    time_outs: Tensor,
    log_ratio: Tensor,
    *,
    gamma: float,
    lam: float,
    cfg: VTraceCfg,
) -> Corrected:
    """Value targets and advantages of a rollout under the present policy.

    Where both policies are the same and nothing is clipped, these are the targets and
    the advantages of GAE. With `lam` 1 the advantage is IMPALA's,
    `rho_s (r_s + gamma v_{s+1} - V(x_s))`; with less it rests on the value of the next
    state by that share, as that of GAE does.

    Args:
        rewards: [T, N]
        values: [T, N] of the states acted in, by the present critic.
        last_values: [N] of the states after the last step.
        dones: [T, N] 1 where a step ended the episode.
        time_outs: [T, N] 1 where it would have gone on: the reward then has the value
            of the state acted in on top, as RSL-RL's PPO has it. A fall is worth
            nothing more.
        log_ratio: [T, N] log of the probability of the action under the present policy
            over that under the policy that acted.
        gamma: Discount of a step.
        lam: Share of what came later that a target takes over.
        cfg: Where ratios are clipped.
    """
    ratio = log_ratio.exp()
    rho = ratio.clamp(max=cfg.rho_bar)
    trace = lam * ratio.clamp(max=cfg.c_bar)
    discount = gamma * (1.0 - dones)
    paid = rewards + gamma * values * time_outs
    next_values = torch.cat([values[1:], last_values[None]])
    deltas = rho * (paid + discount * next_values - values)
    beyond = torch.zeros_like(values)
    for step in reversed(range(len(deltas))):
        later = beyond[step + 1] if step + 1 < len(deltas) else 0.0
        beyond[step] = deltas[step] + discount[step] * trace[step] * later
    beyond_next = torch.cat([beyond[1:], torch.zeros_like(last_values)[None]])
    after = next_values + lam * beyond_next
    return Corrected(
        targets=values + beyond,
        advantages=rho * (paid + discount * after - values),
        # Rounding makes equal policies differ by less.
        clipped=(ratio > cfg.rho_bar * 1.001).float(),
    )
