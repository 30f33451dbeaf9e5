"""The KL-penalty form of PPO (Schulman et al. 2017, section 4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from rsl_rl.models import MLPModel
from torch import Tensor

from policy.parallel.ranks import ALONE, Ranks

NO_CLIP = 1e6
"""Clip range of a ratio that is not clipped."""


@dataclass(frozen=True, kw_only=True)
class KlPenaltyCfg:
    """Holds an update near the old policy by a penalty instead of by clipping."""

    kind: Literal["fixed", "adaptive"]
    """`fixed` adds `beta * KL(old, new)` to the loss; `adaptive` halves or doubles beta
    where the KL leaves [target / 1.5, 1.5 target]."""
    beta: float = 1.0
    """Weight of the penalty, the first one where it is adapted."""
    target: float = 0.01
    """KL an update should move the policy by, nats."""

    def __post_init__(self) -> None:
        if self.beta <= 0.0 or self.target <= 0.0:
            raise ValueError(
                f"beta and target must be positive, got {self.beta} and {self.target}"
            )

    def make(self, ranks: Ranks = ALONE) -> KlPenalty:
        """The penalty of a training that `ranks` do together."""
        return KlPenalty(self, ranks)

    @property
    def algorithm(self) -> dict[str, Any]:
        """Settings of RSL-RL's PPO that clip nothing and keep the step size."""
        return {
            "clip_param": NO_CLIP,
            "use_clipped_value_loss": False,
            "schedule": "fixed",
        }


class KlPenalty:
    """The penalty, in the place RSL-RL keeps for a mirror loss.

    That place is called in every minibatch, after the actor's pass, and adds
    `mirror_loss_coeff` times what `compute_loss` gives to the loss.
    """

    use_mirror_loss = True

    def __init__(self, cfg: KlPenaltyCfg, ranks: Ranks = ALONE) -> None:
        self._cfg, self._ranks = cfg, ranks
        self._kls: list[float] = []
        self.mirror_loss_coeff = cfg.beta

    @property
    def beta(self) -> float:
        """Weight of the penalty in the next update."""
        return self.mirror_loss_coeff

    @beta.setter
    def beta(self, value: float) -> None:
        self.mirror_loss_coeff = value

    def saved(self) -> dict[str, Any]:
        """What a training goes on from."""
        return {"kl_beta": self.beta}

    def load(self, saved: dict[str, Any]) -> None:
        """Go on from what `saved` gave."""
        self.beta = float(saved["kl_beta"])

    def after_update(self, minibatches: int) -> dict[str, float]:
        """Adapt beta; gives the KL of the update and the new weight, by name.

        Args:
            minibatches: Of an epoch.
        """
        return {"kl": self.adapt(minibatches), "kl_beta": self.beta}

    def augment_batch(self, batch: Any, original_batch_size: int) -> None:
        """Leave the minibatch as it is."""

    def compute_loss(
        self, actor: MLPModel, batch: Any, original_batch_size: int
    ) -> Tensor:
        """Mean KL(old, new) of a minibatch."""
        kl = actor.get_kl_divergence(
            batch.old_distribution_params, actor.output_distribution_params
        ).mean()
        self._kls.append(float(kl.detach()))
        return kl

    def adapt(self, minibatches: int) -> float:
        """Double or halve beta after an update; gives the KL of its last epoch.

        Args:
            minibatches: Of an epoch.
        """
        last = self._kls[-minibatches:]
        self._kls = []
        kl = self._ranks.means({"kl": sum(last) / len(last)})["kl"]
        if self._cfg.kind != "adaptive":
            return kl
        if kl < self._cfg.target / 1.5:
            self.beta = max(self.beta / 2.0, 1e-4)
        elif kl > self._cfg.target * 1.5:
            self.beta = min(self.beta * 2.0, 1e4)
        return kl
