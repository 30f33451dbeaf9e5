"""Settings of a fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


def _require_members(num_members: int) -> None:
    if num_members < 2:
        raise ValueError(f"spread of an ensemble needs 2 members, got {num_members}")


@dataclass(frozen=True, kw_only=True)
class LinearCfg:
    """The default: a reward linear in the gait descriptors."""

    num_members: int = 5
    """Models fitted to resampled answers; their spread measures what is unknown."""
    prior_precision: float = 1.0
    """Of the Gaussian prior on each weight; larger means weaker opinions."""

    def __post_init__(self) -> None:
        _require_members(self.num_members)
        if self.prior_precision <= 0.0:
            raise ValueError(
                f"prior_precision must be positive, got {self.prior_precision}"
            )


@dataclass(frozen=True, kw_only=True)
class MlpCfg:
    """A small network on the gait descriptors, for when answers are plenty."""

    num_members: int = 3
    """Networks fitted to resampled answers."""
    hidden_size: int = 64
    """Units in each of the two hidden layers."""
    num_updates: int = 100
    """Gradient steps of a fit."""
    batch_size: int = 64
    """Answers in a gradient step."""
    learning_rate: float = 2e-3
    """AdamW step size."""
    weight_decay: float = 0.1
    """AdamW weight decay."""
    smoothing: float = 0.02
    """Targets are read as no closer to 0 and 1 than this."""
    mean_reward_penalty: float = 1e-3
    """On the squared mean reward of a batch: it holds what no answer fixes."""
    min_crop: float = 0.7
    """Shortest random piece of a clip a gradient step looks at, as a share of it."""
    steps_per_clip: int = 8
    """Steps looked at in that piece."""

    def __post_init__(self) -> None:
        _require_members(self.num_members)


@dataclass(frozen=True, kw_only=True)
class GpCfg:
    """A Gaussian process over the steps of a clip: linear plus squared exponential."""

    num_members: int = 5
    """Models fitted to resampled answers."""
    num_features: int = 128
    """Random Fourier features that stand for the squared exponential kernel."""
    length_scale: float = 0.5
    """Distance at which steps stop being alike, in the usual distance of two steps."""
    amplitude: float = 4.0
    """Logit by which the part that is not linear is expected to shift a pair."""

    def __post_init__(self) -> None:
        _require_members(self.num_members)


@dataclass(frozen=True, kw_only=True)
class ReliabilityCfg:
    """How reliable each of several raters is, estimated together with the reward."""

    enabled: bool = True
    """Off, all raters are expected to err as often as `FitCfg.error_share` says."""
    prior_answers: float = 10.0
    """Answers of a rater it takes to count as much as that expectation."""
    rounds: int = 3
    """Times reward and reliabilities are estimated in turn."""


Kind = Literal["linear", "gp", "mlp"]
"""The models there are, from the stiffest to the most flexible."""


@dataclass(frozen=True, kw_only=True)
class FitCfg:
    """How a reward model is fitted to the answers collected so far."""

    kind: Kind | Literal["auto"] = "linear"
    """Model: `linear` in the gait descriptors, a Gaussian process (`gp`) or a small
    network (`mlp`) on them, or `auto`, whichever foresees held-out answers best."""
    error_share: float = 0.3
    """Share of the answers expected to be random, in [0, 1)."""
    tie_threshold: float = 1.0
    """Lead, in logits, below which a rater is expected to answer "equal"; 0 counts
    "equal" as half an answer for either side."""
    fall_logit: float = 3.0
    """Fixed logit against a clip that ends in a fall; it is not learned."""
    folds: int = 5
    """Groups of episodes left out in turn to measure accuracy."""
    linear: LinearCfg = LinearCfg()
    """Settings of the `linear` model."""
    gp: GpCfg = GpCfg()
    """Settings of the `gp` model."""
    mlp: MlpCfg = MlpCfg()
    """Settings of the `mlp` model."""
    reliability: ReliabilityCfg = ReliabilityCfg()
    """Where several raters answered."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.error_share < 1.0:
            raise ValueError(f"error_share must lie in [0, 1), got {self.error_share}")
        if self.tie_threshold < 0.0:
            raise ValueError(
                f"tie_threshold must not be negative, got {self.tie_threshold}"
            )
        if self.folds < 2:
            raise ValueError(f"folds must be at least 2, got {self.folds}")
