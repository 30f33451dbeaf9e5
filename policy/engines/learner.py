"""The learner: rollouts of older policies in, clipped steps of the present one out.

Two policies take part in an update beside the one that is changed. The rollout was
collected by one, mu, a few versions old; V-trace turns it into what it says of the
present policy, pi. PPO's steps then begin from pi, and its ratio is clipped around it
(as in Hilton et al. 2022, arXiv 2110.00641, who keep both apart). With mu = pi this is
PPO's update.

Shapes: T steps of a rollout, N environments of all actors together.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict
from torch import Tensor

from data.features import FEATURE_DIM
from policy.training.ppo import RewardPpo

from .actor import history_rows
from .trajectory import Trajectory
from .vtrace import VTraceCfg, vtrace


class VTracePpo(RewardPpo):
    """`RewardPpo` on rollouts that others have collected."""

    correction: VTraceCfg = VTraceCfg()
    clipped_share: float = 0.0
    """Share of the steps of the last rollout that would have counted more than they
    may."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        self._seen: dict[int, tuple[Tensor, Tensor]] = {}
        self._last: dict[int, int] = {}

    def adopt(self, rollouts: Sequence[Trajectory]) -> TensorDict:
        """Take `rollouts` for one, side by side; gives the observations after them."""
        first = rollouts[0]
        steps = len(first.log_probs)
        envs = sum(each.log_probs.shape[1] for each in rollouts)
        groups = tuple(first.observations)
        last = TensorDict(
            {g: _beside([r.last_observations[g] for r in rollouts], 0) for g in groups},
            batch_size=[envs],
        )
        width = first.actions.shape[-1]
        storage = RolloutStorage("rl", envs, steps, last, [width], self.device)
        for group in groups:
            seen = _beside([r.observations[group] for r in rollouts])
            storage.observations[group].copy_(seen)
        storage.actions.copy_(_beside([r.actions for r in rollouts]))
        storage.dones.copy_(_beside([r.dones for r in rollouts])[..., None])
        self.storage = storage
        self.features = _beside([r.features for r in rollouts])
        self.starts = _beside([r.starts for r in rollouts])
        self.time_outs = _beside([r.time_outs for r in rollouts])
        self.valid = _beside([r.valid for r in rollouts])
        self._acted = _beside([r.log_probs for r in rollouts])
        self._recall(rollouts)
        self._estimate()
        return last

    def compute_returns(self, obs: TensorDict) -> None:
        """Score the rollout; value targets and advantages of the present policy."""
        storage = self.storage
        taught = vtrace(
            self.paid(),
            storage.values[..., 0],
            self.critic(obs).detach()[..., 0],
            storage.dones[..., 0].float(),
            self.time_outs,
            storage.actions_log_prob[..., 0] - self._acted,
            gamma=self.gamma,
            lam=self.lam,
            cfg=self.correction,
        )
        self.clipped_share = float(taught.clipped.mean())
        storage.returns.copy_(taught.targets[..., None])
        advantages = taught.advantages[..., None]
        storage.advantages = (advantages - advantages.mean()) / (
            advantages.std() + 1e-8
        )

    def _estimate(self) -> None:
        """What the present networks say of every step."""
        storage = self.storage
        obs = storage.observations.flatten(0, 1)
        shape = storage.values.shape[:2]
        # Their output is a sample; nobody acts on it.
        with torch.random.fork_rng(devices=[]):
            self.actor(obs, stochastic_output=True)
        log_prob = self.actor.get_output_log_prob(storage.actions.flatten(0, 1))
        storage.actions_log_prob.copy_(log_prob.view(*shape, 1))
        storage.distribution_params = tuple(
            part.view(*shape, -1) for part in self.actor.output_distribution_params
        )
        storage.values.copy_(self.critic(obs).view(*shape, 1))

    def _recall(self, rollouts: Sequence[Trajectory]) -> None:
        """Put what each actor did before `rollouts` where a reward looks back, as long
        as they follow one another."""
        rows = history_rows(self.reward_fn)
        if not rows:
            return
        before = []
        for each in rollouts:
            features, starts = map(torch.tensor, (each.features, each.starts))
            held = self._seen.get(each.origin.actor)
            # A rollout that came too late was dropped, and is missing in between.
            if (
                held is None
                or each.origin.sequence != self._last[each.origin.actor] + 1
            ):
                held = _nothing(rows, len(starts[0]))
            self._last[each.origin.actor] = each.origin.sequence
            before.append(held)
            self._seen[each.origin.actor] = (
                torch.cat([held[0], features])[-rows:],
                torch.cat([held[1], starts])[-rows:],
            )
        self.before = (
            torch.cat([features for features, _ in before], dim=1),
            torch.cat([starts for _, starts in before], dim=1),
        )


def _nothing(rows: int, envs: int) -> tuple[Tensor, Tensor]:
    """What was before an actor's first rollout: every episode there began alone."""
    return torch.zeros(rows, envs, FEATURE_DIM), torch.ones(rows, envs).bool()


def _beside(parts: Sequence[np.ndarray], dim: int = 1) -> Tensor:
    return torch.from_numpy(np.concatenate(parts, axis=dim))
