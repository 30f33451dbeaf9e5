"""How much exploration noise a retraining has, in units of the action.

Noise must outlive the questions, or nobody ever sees the better gait. But it makes feet
chatter on the ground: where the rate of steps is paid for, a policy is then paid for
what is gone without noise, so that noise has to come down before it is done; elsewhere
that costs more than it gives, as less noise learns more slowly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from rewardmodel.models.model import RewardModel

from .context import RoundContext

_MUCH = 0.25
"""Share of what the most important habit pays, from which on another counts."""
_GONE = 1.5
"""Times `PutBack.calm_std` up to which a policy's noise has come down."""


@dataclass(frozen=True, kw_only=True)
class Noise:
    """The noise of one training."""

    start_std: float | None = None
    """At its start; None: what the policy has."""
    final_std: float | None = None
    """The most at its end; None: what it comes to."""
    calm_from: float = 0.0
    """Share of the training after which it comes down to that."""


@dataclass(frozen=True, kw_only=True)
class Descending:
    """Much noise at first, less in later rounds, next to none at the end."""

    early: float = 0.7
    """In the first 60 % of the rounds."""
    late: float = 0.5
    """In the rounds after that."""
    last: float = 0.4
    """At the start of the last round."""
    final: float = 0.1
    """The most at its end: a gait that only noise sets going is no gait."""

    def noise(
        self, context: RoundContext, *, policy_std: float, pays_for_rate: bool
    ) -> Noise:
        """The noise of the retraining of `context`."""
        if context.is_last:
            return Noise(start_std=self.last, final_std=self.final)
        early = context.number <= 0.6 * context.rounds
        return Noise(start_std=self.early if early else self.late)


@dataclass(frozen=True, kw_only=True)
class PutBack:
    """What the policy has, and more where it has little left."""

    first: float = 0.3
    """What a first retraining begins with where the policy has little left."""
    later: float = 0.15
    """What later ones begin with there: what was learned to do with little noise is
    lost under more, and half of a training is spent on learning it once more."""
    calm_std: float = 0.1
    """The most at the end of a training that pays for the rate of steps."""
    calm_from: float = 0.85
    """Share of a training after which it comes down to that."""

    def noise(
        self, context: RoundContext, *, policy_std: float, pays_for_rate: bool
    ) -> Noise:
        """The noise of the retraining of `context`.

        Args:
            context: The round.
            policy_std: Mean noise of the policy it begins from.
            pays_for_rate: Whether the rate of steps is much of what is paid for.
        """
        found = Noise()
        if policy_std < _GONE * self.calm_std:
            found = Noise(start_std=self.first if context.number == 1 else self.later)
        if not pays_for_rate:
            return found
        return replace(found, final_std=self.calm_std, calm_from=self.calm_from)


Exploration = Descending | PutBack
"""What a method can decide; its name is written into a run's configuration."""


def pays_for_rate(model: RewardModel) -> bool:
    """Whether the rate of steps is among the few things that a style is paid for."""
    heights = model.payer.heights
    if heights is None:
        return False
    return bool(heights[-1] > 0 and heights[-1] >= _MUCH * heights.max())
