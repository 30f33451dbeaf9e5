"""Soft actor-critic: how the networks change by one batch of remembered steps.

Shapes: B steps of a batch, D numbers of an observation.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, ClassVar

import torch
from torch import Tensor

from policy.training.mirror import Mirror
from policy.training.reward_ppo import ScoreFn

from .ring import Batch, Ring
from .sac_cfg import SacCfg
from .tanh_actor import new_actor
from .twin_critic import TwinCritic


class Sac:
    """Actor, twin critics and temperature."""

    OF_RANK: ClassVar[tuple[str, ...]] = ()
    reward_fn: ScoreFn | None = None
    mirror: Mirror | None = None
    """Learn from half of the steps in the mirror."""

    def __init__(
        self, cfg: SacCfg, obs_dim: int, bound: Tensor, actor_sizes: tuple[int, ...]
    ) -> None:
        device = bound.device
        self.cfg = cfg
        self.actor = new_actor(cfg, obs_dim, bound, actor_sizes).to(device)
        self.critic = TwinCritic(obs_dim, cfg.critic_sizes).to(device)
        self.target = copy.deepcopy(self.critic).requires_grad_(False)
        self.log_alpha = torch.tensor(math.log(cfg.first_alpha), device=device)
        self.log_alpha.requires_grad_()
        weights = [p for p in self.actor.parameters() if p.requires_grad]
        self._actor_step = torch.optim.Adam(weights, lr=cfg.learning_rate, fused=True)
        critic_weights = list(self.critic.parameters())
        self._critic_step = torch.optim.Adam(
            critic_weights, lr=cfg.learning_rate, fused=True
        )
        self._alpha_step = torch.optim.Adam(
            [self.log_alpha], lr=cfg.alpha_rate, fused=True
        )
        self.joint_entropy = cfg.joint_entropy
        """What a joint is to keep now."""
        self.updates = 0
        """Done so far."""
        self.looking_on = 0
        """Updates in which the critics alone still learn."""

    def learn(self, ring: Ring, updates: int) -> dict[str, float]:
        """Do `updates` from `ring`; mean figures of them by name."""
        cfg = self.cfg
        sums: dict[str, Tensor] = {}
        counts: dict[str, int] = {}
        for _ in range(updates):
            batch = ring.sample(cfg.batch, n_step=cfg.n_step, gamma=cfg.gamma)
            if self.mirror is not None:
                batch = half_mirrored(batch, self.mirror)
            figures, errors = self.update(batch)
            ring.learned(batch, errors)
            for name, value in figures.items():
                sums[name] = sums.get(name, torch.zeros_like(value)) + value
                counts[name] = counts.get(name, 0) + 1
        return {name: float(total) / counts[name] for name, total in sums.items()}

    def update(self, batch: Batch) -> tuple[dict[str, Tensor], Tensor]:
        """Change the critics by `batch`, and the actor when it is its turn; figures,
        and how far off [B] the critics were."""
        cfg, actor = self.cfg, self.actor
        obs = actor.normalizer(batch.obs)
        with torch.no_grad():
            later, log_prob = actor.sample(batch.later_obs)
            worth = self.target(
                actor.normalizer(batch.later_obs), later / actor.bound
            ).amin(dim=0)
            soft = worth - self.log_alpha.exp() * log_prob
            target = cfg.reward_scale * batch.gain + batch.discount * soft
        values = self.critic(obs, batch.action / actor.bound)
        missed = values - target
        counted = missed.square()
        if batch.weight is not None:
            counted = batch.weight * counted
        critic_loss = counted.mean(dim=-1).sum()
        self._critic_step.zero_grad()
        critic_loss.backward()
        self._critic_step.step()
        with torch.no_grad():
            for own, theirs in zip(
                self.target.parameters(), self.critic.parameters(), strict=True
            ):
                own.lerp_(theirs, cfg.tau)
        self.updates += 1
        figures = {"critic": critic_loss.detach(), "value": values.detach().mean()}
        looks_on, self.looking_on = self.looking_on > 0, max(0, self.looking_on - 1)
        if not looks_on and self.updates % cfg.actor_every == 0:
            figures |= self._update_actor(obs, batch)
        return figures, missed.detach().abs().mean(dim=0)

    def _update_actor(self, obs: Tensor, batch: Batch) -> dict[str, Tensor]:
        cfg, actor = self.cfg, self.actor
        action, log_prob = actor.sample(batch.obs)
        share = action / actor.bound
        self.critic.requires_grad_(False)
        worth = self.critic(obs, share).amin(dim=0)
        self.critic.requires_grad_(True)
        loss = (self.log_alpha.exp().detach() * log_prob - worth).mean()
        if cfg.clone_weight:
            missed = (actor(batch.obs) - batch.action).square().mean()
            loss = loss / worth.abs().mean().detach() + cfg.clone_weight * missed
        self._actor_step.zero_grad()
        loss.backward()
        self._actor_step.step()
        entropy = -log_prob.detach().mean()
        wanted = 12 * self.joint_entropy
        self._alpha_step.zero_grad()
        (self.log_alpha * (entropy - wanted)).backward()
        self._alpha_step.step()
        alpha = self.log_alpha.detach().exp()
        return {"actor": loss.detach(), "entropy": entropy, "temperature": alpha}

    def networks(self) -> dict[str, dict[str, Tensor]]:
        """Weights by the name of their network."""
        return {
            "actor": self.actor.state_dict(),
            "critic": self.critic.state_dict(),
            "temperature": {"log": self.log_alpha.detach()},
        }

    def save(self) -> dict[str, Any]:
        """All it goes on from."""
        return {
            "actor_state_dict": self.actor.state_dict(),
            "critic_state_dict": self.critic.state_dict(),
            "target_state_dict": self.target.state_dict(),
            "log_alpha": self.log_alpha.detach().clone(),
            "updates": self.updates,
            "looking_on": self.looking_on,
            "optimizers": [step.state_dict() for step in self._steps],
        }

    def load(self, loaded_dict: dict[str, Any], load_cfg: None, strict: bool) -> None:
        """Go on from what `save` gave, among other things."""
        saved = loaded_dict
        self.actor.load_state_dict(saved["actor_state_dict"], strict=strict)
        self.critic.load_state_dict(saved["critic_state_dict"], strict=strict)
        self.target.load_state_dict(saved["target_state_dict"], strict=strict)
        with torch.no_grad():
            self.log_alpha.copy_(saved["log_alpha"])
        self.updates = int(saved["updates"])
        self.looking_on = int(saved["looking_on"])
        for step, state in zip(self._steps, saved["optimizers"], strict=True):
            step.load_state_dict(state)

    @property
    def _steps(self) -> tuple[torch.optim.Adam, ...]:
        return self._actor_step, self._critic_step, self._alpha_step


def half_mirrored(batch: Batch, mirror: Mirror) -> Batch:
    """`batch` with its first half in the mirror, as likely and as good."""
    half = len(batch.obs) // 2

    def turned(values: Tensor, image: Callable[[Tensor], Tensor]) -> Tensor:
        return torch.cat([image(values[:half]), values[half:]])

    return replace(
        batch,
        obs=turned(batch.obs, mirror.obs),
        action=turned(batch.action, mirror.action),
        later_obs=turned(batch.later_obs, mirror.obs),
    )
