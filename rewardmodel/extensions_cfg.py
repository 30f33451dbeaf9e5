"""Settings of what is off by default."""

from __future__ import annotations

from dataclasses import dataclass


def require_members(num_members: int) -> None:
    """
    Raises:
        ValueError: so few members have no spread.
    """
    if num_members < 2:
        raise ValueError(f"spread of an ensemble needs 2 members, got {num_members}")


@dataclass(frozen=True, kw_only=True)
class NetworkCfg:
    """What the small networks have in common."""

    num_members: int = 3
    """Networks fitted to resampled answers."""
    hidden_size: int = 64
    """Units in each hidden layer."""
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

    def __post_init__(self) -> None:
        require_members(self.num_members)


@dataclass(frozen=True, kw_only=True)
class MlpCfg(NetworkCfg):
    """A small network on the gait descriptors, for when answers are plenty."""

    steps_per_clip: int = 8
    """Steps looked at in that piece."""


@dataclass(frozen=True, kw_only=True)
class SequenceCfg(NetworkCfg):
    """What models that look back have in common."""

    steps_per_clip: int = 16
    """Steps looked at in that piece, each with what came before it."""
    history_steps: int = 24
    """Steps looked back: 0.48 s at 50 Hz, about a stride."""
    stride: int = 3
    """Every how many of the steps looked back is looked at."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self.stride <= self.history_steps:
            raise ValueError(
                f"stride must lie in [1, history_steps {self.history_steps}], "
                f"got {self.stride}"
            )


@dataclass(frozen=True, kw_only=True)
class HistoryCfg(SequenceCfg):
    """The network of `MlpCfg` on the last steps at once, for rhythms."""


@dataclass(frozen=True, kw_only=True)
class TransformerCfg(SequenceCfg):
    """A small causal transformer over the clip."""

    hidden_size: int = 32
    """Numbers that stand for a step; twice as many in the layer behind attention."""
    learning_rate: float = 5e-3
    """AdamW step size."""
    steps_per_clip: int = 8
    """Steps looked at in that piece, each with what came before it."""
    num_heads: int = 8
    """Attention heads; they divide `hidden_size`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.num_heads < 1 or self.hidden_size % self.num_heads:
            raise ValueError(
                f"num_heads must divide hidden_size {self.hidden_size}, "
                f"got {self.num_heads}"
            )


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
        require_members(self.num_members)


@dataclass(frozen=True, kw_only=True)
class RawCfg:
    """Networks on raw rows, as published (B-Pref: Lee et al. 2021)."""

    num_members: int = 3
    """Networks, each fitted to all answers."""
    hidden_size: int = 256
    """Units in each of three hidden layers."""
    learning_rate: float = 3e-4
    """Adam step size."""
    batch_size: int = 128
    """Answers in a gradient step."""
    most_epochs: int = 200
    """Times that every answer is looked at, at most."""
    enough_accuracy: float = 0.97
    """Share of the fitted answers foreseen at which a fit ends."""
    summed_steps: int = 50
    """Steps of a published segment, whose rewards are summed up."""
    min_crop: float = 1.0
    """Shortest random piece of a clip a gradient step looks at, as a share of it."""

    def __post_init__(self) -> None:
        require_members(self.num_members)


ModelCfg = GpCfg | MlpCfg | HistoryCfg | TransformerCfg | RawCfg
MODELS: dict[str, type[ModelCfg]] = {
    "gp": GpCfg,
    "mlp": MlpCfg,
    "history": HistoryCfg,
    "transformer": TransformerCfg,
    "raw": RawCfg,
}
"""By the name of the kind whose settings they are."""


@dataclass(frozen=True, kw_only=True)
class SemiSupervisedCfg:
    """Pairs nobody answered, on which the reward's own opinion counts (SURF)."""

    confidence: float = 0.95
    """Probability from which on the ensemble's opinion counts as an answer."""
    error_share: float = 0.8
    """Share of such opinions taken for random: how much less than answers they say."""
    pairs_per_answer: int = 4
    """Pairs nobody answered that are looked at for every answer."""

    def __post_init__(self) -> None:
        if not 0.5 < self.confidence < 1.0 or not 0.0 <= self.error_share < 1.0:
            raise ValueError(
                "confidence must lie in (0.5, 1) and error_share in [0, 1), got "
                f"{self.confidence} and {self.error_share}"
            )
        if self.pairs_per_answer < 1:
            raise ValueError(
                f"pairs_per_answer must be at least 1, got {self.pairs_per_answer}"
            )


@dataclass(frozen=True, kw_only=True)
class LabelFilterCfg:
    """Answers that look wrong to a reward that has not seen them (RIME)."""

    below: float = 0.2
    """Probability below which an answer is taken for random, as a reward foresees it
    that was fitted to others."""

    def __post_init__(self) -> None:
        if not 0.0 < self.below < 0.5:
            raise ValueError(f"below must lie in (0, 0.5), got {self.below}")
