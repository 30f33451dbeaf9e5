"""What of a learned reward a retraining is paid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from rewardmodel.models.model import RewardModel
from rewardmodel.paid.caution import CautiousReward

from .context import RoundContext

if TYPE_CHECKING:
    # A reward can be fitted where nothing is trained.
    from policy.training.reward_ppo import RewardFn


@dataclass(frozen=True, kw_only=True)
class SurelyLiked:
    """What the answers are sure of, weight by weight of a linear reward."""

    kind: ClassVar = "linear"

    sure: float = 2.0
    """Where answers do not err, from the second retraining on: deviations over the
    ensemble that a weight must be above 0 to pay at all. The first needs a reward that
    tells walking from standing; later ones must not pay for what chance made positive.
    0 pays all."""
    caution: float = 1.0
    """Where answers err: deviations over the ensemble within which a habit is paid only
    as was expected of it before any answer."""

    def of(self, model: RewardModel, context: RoundContext) -> RewardFn:
        """The reward of the retraining of `context`."""
        if context.noisy:
            # What moves well takes more effort than what stands, and answers that err
            # cannot tell the two apart.
            return CautiousReward(model, self.caution, pays_effort=self.caution == 0.0)
        sure = self.sure if context.number > 1 else 0.0
        return CautiousReward(model, sure=sure)


@dataclass(frozen=True, kw_only=True)
class AsFitted:
    """The reward as it was fitted, for models of any kind."""

    kind: ClassVar = None

    def of(self, model: RewardModel, context: RoundContext) -> RewardFn:
        """`model`, whatever the round."""
        return model


Paid = SurelyLiked | AsFitted
"""What a method can decide; its name is written into a run's configuration."""
