"""PPO with the reward handed in as a callable that scores whole rollouts.

Shapes: T steps of a rollout, N environments, F feature columns.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from types import BuiltinFunctionType, FunctionType, MethodType
from typing import Any, ClassVar, Protocol, runtime_checkable

import torch
from rsl_rl.algorithms import PPO
from rsl_rl.models import MLPModel
from tensordict import TensorDict
from torch import Tensor

from data.errors import GaitprefError
from policy.parallel.ranks import ALONE, Ranks

from .clipped_update import clipped_update
from .mirror import Mirror

LOOKING_ON_RATE = 1e-3
"""Step size of a critic that learns alone."""

_FUNCTIONS = (FunctionType, BuiltinFunctionType, MethodType, partial)


class RewardNotFinite(GaitprefError, FloatingPointError):
    """A reward that is no number."""


class ScoreFn(Protocol):
    """Anything that scores feature rows: hand-written, learned, or a test's own."""

    def __call__(self, features: Tensor, starts: Tensor) -> Tensor:
        """Reward [T, N] of `features` [T, N, F]; `starts` [T, N] begin an episode."""
        ...


@runtime_checkable
class RewardFn(ScoreFn, Protocol):
    """A score that says how far it looks back."""

    @property
    def history_steps(self) -> int:
        """Steps before a step that matter to its reward: it is shown as many of the
        rollout before."""
        ...


@runtime_checkable
class Telling(Protocol):
    """A reward that tells more of the rollout it scored last."""

    @property
    def figures(self) -> dict[str, float]:
        """Numbers by TensorBoard tag."""
        ...


def history_of(score: ScoreFn) -> int:
    """Steps before a step that matter to `score`: none of a plain function, which has
    no way to say.

    Raises:
        TypeError: it is an object that does not say.
    """
    if isinstance(score, RewardFn):
        return score.history_steps
    if isinstance(score, _FUNCTIONS):
        return 0
    raise TypeError(
        f"{type(score).__name__} scores rows and has no `history_steps`, which says "
        "how far it looks back; 0 if it does not"
    )


def figures_of(score: ScoreFn | None) -> dict[str, float]:
    """What `score` tells of the rollout it scored last, if it does."""
    return score.figures if isinstance(score, Telling) else {}


@runtime_checkable
class OfRollout(Protocol):
    """A reward that also looks at a rollout as a whole, as at a mean over it."""

    def of_rollout(
        self,
        features: Tensor,
        starts: Tensor,
        steps: int,
        mean: Callable[[Tensor], Tensor],
    ) -> Tensor:
        """Reward [steps, N] of the rollout that the last `steps` of `features`
        [T, N, F] are; those before it are only looked back at.

        `mean` takes it over what every rank has collected, where several train.
        """
        ...


@runtime_checkable
class Wanting(Protocol):
    """A reward of which a part is what is wanted, beside what is always paid."""

    @property
    def wanted(self) -> ScoreFn:
        """That part."""
        ...


class Bonus(Protocol):
    """A reward beside that of the rollout, which may learn from what it has seen."""

    def __call__(self, features: Tensor) -> Tensor:
        """Bonus [T, N] of rows [T, N, F]."""
        ...

    def state_dict(self) -> dict[str, Any]:
        """Weights of the bonus."""
        ...

    def load_state_dict(self, state_dict: dict[str, Any], /) -> Any:
        """Go on from what `state_dict` gave."""
        ...


class Penalty(Protocol):
    """A term of the loss, in the place RSL-RL keeps for a mirror loss."""

    def after_update(self, minibatches: int) -> dict[str, float]:
        """Figures by name of an update whose epochs had `minibatches`."""
        ...

    def saved(self) -> dict[str, Any]:
        """What the penalty goes on from, by names of its own."""
        ...

    def load(self, saved: dict[str, Any], /) -> None:
        """Go on from what `saved` gave, among other things."""
        ...


class RewardPpo(PPO):
    """PPO that scores a whole rollout at once with a `RewardFn`, once it is collected.

    Without one it uses the environment's own reward. Scoring once per rollout costs
    less than step by step and lets a reward look at more than one row.
    """

    reward_fn: ScoreFn | None = None
    reference: MLPModel | None = None
    """The policy training began from, to measure how far this one has gone."""
    bonus: Bonus | None = None
    penalty: Penalty | None = None
    mirror: Mirror | None = None
    """Learn from every step in the mirror too."""
    ranks: Ranks = ALONE
    """Who learns the same, each from rollouts of its own."""
    OF_RANK: ClassVar = ("before", "bonus_state_dict")
    """What `save` gives that each rank has for itself."""
    features: Tensor
    """Feature rows [T, N, F] of the rollout."""
    starts: Tensor
    """[T, N] whether a step began an episode."""
    time_outs: Tensor
    """[T, N] 1 where a step ended an episode that would have gone on, else 0."""
    valid: Tensor
    """[T, N] 0 where a simulation diverged, else 1."""
    looking_on: int = 0
    """Updates in which the critic alone still learns."""
    before: tuple[Tensor, Tensor] | None = None
    """Features [H, N, F] and starts [H, N] of the last steps before the rollout."""

    def process_env_step(
        self, obs: TensorDict, rewards: Tensor, dones: Tensor, extras: dict[str, Any]
    ) -> None:
        """Record one step, and what is needed to score it later."""
        step = self.storage.step
        if step == 0:
            shape = (self.storage.num_transitions_per_env, self.storage.num_envs)
            width = extras["features"].shape[-1]
            self.features = torch.zeros(*shape, width, device=self.device)
            self.starts = torch.zeros(shape, dtype=torch.bool, device=self.device)
            self.time_outs = torch.zeros(shape, device=self.device)
            self.valid = torch.ones(shape, device=self.device)
        self.features[step] = extras["features"]
        self.starts[step] = extras["starts"]
        self.time_outs[step] = extras["time_outs"].float()
        self.valid[step] = 1.0 - extras["aborted"].float()
        # The parent would bootstrap time-outs now; `compute_returns` does it instead,
        # when the reward is known.
        untimed = {key: value for key, value in extras.items() if key != "time_outs"}
        super().process_env_step(obs, rewards, dones, untimed)

    def compute_returns(self, obs: TensorDict) -> None:
        """Score the rollout, bootstrap time-outs, then compute returns (GAE)."""
        rewards = self.paid()
        values = self.storage.values[..., 0]
        bootstrap = self.gamma * values * self.time_outs
        self.storage.rewards.copy_((rewards + bootstrap)[..., None])
        super().compute_returns(obs)
        if self.ranks.size > 1:
            advantages = self.storage.returns - self.storage.values
            mean, std = self.ranks.mean_and_std(advantages)
            self.storage.advantages = (advantages - mean) / (std + 1e-8)

    def paid(self) -> Tensor:
        """Reward [T, N] of every step of the rollout, the bonus included."""
        rewards = self.storage.rewards[..., 0]
        if self.reward_fn is not None:
            rewards = self._scored(self.reward_fn)
            if rewards.shape != self.time_outs.shape:
                raise ValueError(
                    f"the reward of features {tuple(self.features.shape)} must be "
                    f"{tuple(self.time_outs.shape)}, got {tuple(rewards.shape)}"
                )
        rewards = require_finite(rewards) * self.valid
        self.mean_reward = float(rewards.mean())
        self.reference_kl = self._reference_kl()
        if self.bonus is not None:
            rewards = rewards + self.bonus(self.features) * self.valid
        return rewards

    def _scored(self, reward_fn: ScoreFn) -> Tensor:
        """Reward [T, N] of the rollout, seen behind what came before it."""
        features, starts = self.features, self.starts
        history = history_of(reward_fn)
        if history and self.before is not None:
            features = torch.cat([self.before[0], features])
            starts = torch.cat([self.before[1], starts])
        if history:
            self.before = features[-history:].clone(), starts[-history:].clone()
        steps = len(self.features)
        if isinstance(reward_fn, OfRollout):
            return reward_fn.of_rollout(features, starts, steps, self.ranks.mean)
        return reward_fn(features, starts)[len(features) - steps :]

    def penalise(self, penalty: Penalty) -> None:
        """Add `penalty` to the loss, where RSL-RL has its mirror loss."""
        self.penalty = self.symmetry = penalty

    def update(self) -> dict[str, float]:
        """Update both networks: by RSL-RL's own update where there is a penalty."""
        if self.looking_on or self.penalty is None:
            return self._clipped()
        losses = super().update()
        return losses | self.penalty.after_update(self.num_mini_batches)

    def _clipped(self) -> dict[str, float]:
        looks_on = self.looking_on > 0
        if looks_on:
            for group in self.optimizer.param_groups:
                group["lr"] = LOOKING_ON_RATE
        self.looking_on = max(0, self.looking_on - 1)
        return clipped_update(self, self.mirror, self.ranks, actor=not looks_on)

    def save(self) -> dict[str, Any]:
        """Networks and optimiser, what penalty and bonus have learned, and the steps a
        reward looks back at."""
        saved = super().save()
        if self.before is not None:
            saved["before"] = list(self.before)
        if self.bonus is not None:
            saved["bonus_state_dict"] = self.bonus.state_dict()
        if self.penalty is not None:
            saved |= self.penalty.saved()
        if self.looking_on:
            saved["looking_on"] = self.looking_on
        return saved

    def load(
        self, loaded_dict: dict[str, Any], load_cfg: dict | None, strict: bool
    ) -> bool:
        """Load what `save` gave; only networks where not all is loaded."""
        if load_cfg is None:
            self.looking_on = int(loaded_dict.get("looking_on", 0))
            if "before" in loaded_dict:
                features, starts = loaded_dict["before"]
                self.before = features.to(self.device), starts.to(self.device)
            if self.bonus is not None:
                self.bonus.load_state_dict(loaded_dict["bonus_state_dict"])
            if self.penalty is not None:
                self.penalty.load(loaded_dict)
        return super().load(loaded_dict, load_cfg, strict)

    def _reference_kl(self) -> float:
        """Mean log pi - log pi_ref, nats, of the actions taken."""
        if self.reference is None:
            return 0.0
        flat = self.storage.observations.flatten(0, 1)
        self.reference(flat, stochastic_output=True)
        actions = self.storage.actions.flatten(0, 1)
        log_ref = self.reference.get_output_log_prob(actions)
        log_ratio = self.storage.actions_log_prob[..., 0] - log_ref.view_as(
            self.storage.actions_log_prob[..., 0]
        )
        return float(log_ratio.mean())


def require_finite(rewards: Tensor) -> Tensor:
    """`rewards` [T, N] unchanged, or an error that names the environments."""
    if not rewards.isfinite().all():
        bad = (~rewards.isfinite()).any(dim=0).nonzero().flatten().tolist()
        raise RewardNotFinite(
            f"the reward is not finite in environments {bad[:8]}: it must be a number "
            "for every row, so look for a division by 0 or a root of what is negative"
        )
    return rewards
