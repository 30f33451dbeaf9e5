"""Settings of a fit."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Literal, get_args

from data.plain import ADDED_LATER


def _require_members(num_members: int) -> None:
    if num_members < 2:
        raise ValueError(f"spread of an ensemble needs 2 members, got {num_members}")


@dataclass(frozen=True, kw_only=True)
class LinearCfg:
    """The default: a reward linear in the gait descriptors."""

    num_members: int = 50
    """Models fitted to resampled answers, fewer where answers are many; their spread
    measures what is unknown."""
    prior_precision: float = 1.0
    """Of the Gaussian prior on each weight; larger means weaker opinions."""
    unsteady_logit: float = field(default=0.75, metadata=ADDED_LATER)
    """Logit by which a clip that bounces, sways, rocks or slips by the usual amount
    more, each, is expected to lose before any answer. Answers overrule it; wrong ones
    are kept from teaching that rocking is wanted."""
    quiet_logit: float = field(default=0.0, metadata=ADDED_LATER)
    """The same of each habit of moving more than a walk takes, where answers err. A
    reward that expects it before there is a walk prefers standing."""
    hurry: float = field(default=0.0, metadata=ADDED_LATER)
    """How much short, hurried steps are expected to be disliked, whether answers err or
    not, in deviations of the prior: as much as opinions are strong. One that expects it
    before there is a walk prefers standing."""
    told_most: bool = field(default=False, metadata=ADDED_LATER)
    """Where answers err, whether opinions about doing what the robot is told are
    expected to be twice as strong as others, for or against it, and of one piece, those
    about effort half as strong, and those about how the feet go a third."""

    def __post_init__(self) -> None:
        _require_members(self.num_members)
        if self.prior_precision <= 0.0:
            raise ValueError(
                f"prior_precision must be positive, got {self.prior_precision}"
            )


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
        _require_members(self.num_members)


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
    """Of the steps looked back, every how many is looked at."""

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
        _require_members(self.num_members)


@dataclass(frozen=True, kw_only=True)
class SparseCfg:
    """A sum of curves of single descriptors, of which the answers pick few."""

    REMOVED: ClassVar = ("sparsity", "num_updates", "lines_apart", "shared")
    """Settings that older files have: of how curves were picked before."""

    num_members: int = 8
    """Models fitted to resampled answers."""
    single_legs: bool | None = None
    """Whether one leg or one side may matter more than another; None: where the answers
    speak for it (`rewardmodel.sparse_fit.find`)."""
    ends: bool | None = field(default=None, metadata=ADDED_LATER)
    """Whether front feet may matter more than rear ones; None as above. Where either is
    open, not both are tried: single legs can say what ends say."""
    told: bool = field(default=True, metadata=ADDED_LATER)
    """Whether doing what the robot is told may matter: how fast it goes and turns, and
    by how much too fast or slow. Where a task pays for that, a policy cannot change it,
    and what such a curve says is chance, or stands for a habit that goes with speed."""

    def __post_init__(self) -> None:
        _require_members(self.num_members)

    @property
    def is_open(self) -> bool:
        """Whether the answers are still to say something of these settings."""
        return self.single_legs is None or self.ends is None


@dataclass(frozen=True, kw_only=True)
class ReliabilityCfg:
    """How reliable each of several raters is, estimated together with the reward."""

    REMOVED: ClassVar = ("prior_answers", "rounds")
    """Settings that older files have: of how raters were judged before."""

    enabled: bool = True
    """Off, all raters are expected to err as often as `FitCfg.error_share` says."""
    error_share: float = field(default=0.1, metadata=ADDED_LATER)
    """Share of the answers expected to be random, of raters who look."""
    careless: float = field(default=0.1, metadata=ADDED_LATER)
    """How probable it is before any answer that one rater's share is another than the
    others', beside that it is the same, in (0, 1]."""

    def __post_init__(self) -> None:
        if not 0.0 < self.error_share < 1.0 or not 0.0 < self.careless <= 1.0:
            raise ValueError(
                "error_share must lie in (0, 1) and careless in (0, 1], got "
                f"{self.error_share} and {self.careless}"
            )


KindName = Literal["linear", "sparse", "gp", "mlp", "history", "transformer"]
"""The models there are, from the stiffest to the most flexible."""
KIND_NAMES = (*get_args(KindName), "auto")
"""What may be asked for: a model, or how it is chosen."""


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
class FitCfg:
    """How a reward model is fitted to the answers collected so far."""

    kind: KindName | Literal["auto"] = "linear"
    """Model: `linear` in the gait descriptors, curves of few of them and of single legs
    (`sparse`), a Gaussian process (`gp`) or a small network (`mlp`) on them, one on the
    last steps (`history`, `transformer`), or `auto`, whichever foresees held-out
    answers best."""
    error_share: float = 0.3
    """Share of the answers expected to be random, in [0, 1)."""
    adapt: bool = field(default=True, metadata=ADDED_LATER)
    """Whether `error_share` and the prior of the `linear` model are only where
    expectations start, and the answers say what they are; a fitted reward keeps what
    was found."""
    answers_err: bool | None = field(default=None, metadata=ADDED_LATER)
    """Whether more answers are random than can be overlooked. None: this fit decides by
    its own evidence; True or False: decided before, and only how many is left to it."""
    tie_threshold: float = 1.0
    """Lead, in logits, below which a rater is expected to answer "equal"; 0 counts
    "equal" as half an answer for either side."""
    doubted_below: float = field(default=0.0, metadata=ADDED_LATER)
    """Probability below which an answer is taken for random, as a reward foresees it
    that was fitted to others; 0 takes none for random."""
    fall_logit: float = 3.0
    """Fixed logit against a clip that ends in a fall; it is not learned."""
    folds: int = 5
    """Groups of episodes left out in turn to measure accuracy."""
    linear: LinearCfg = LinearCfg()
    """Settings of the `linear` model."""
    sparse: SparseCfg = field(default=SparseCfg(), metadata=ADDED_LATER)
    """Settings of the `sparse` model."""
    gp: GpCfg = GpCfg()
    """Settings of the `gp` model."""
    mlp: MlpCfg = MlpCfg()
    """Settings of the `mlp` model."""
    history: HistoryCfg = field(default=HistoryCfg(), metadata=ADDED_LATER)
    """Settings of the `history` model."""
    transformer: TransformerCfg = field(default=TransformerCfg(), metadata=ADDED_LATER)
    """Settings of the `transformer` model."""
    reliability: ReliabilityCfg = ReliabilityCfg()
    """Where several raters answered."""
    semi_supervised: SemiSupervisedCfg | None = field(
        default=None, metadata=ADDED_LATER
    )
    """How much the reward's own opinion counts; None, not at all."""

    def __post_init__(self) -> None:
        if self.kind not in KIND_NAMES:
            raise ValueError(
                f"no model is called {self.kind!r}; there are {', '.join(KIND_NAMES)}"
            )
        if not 0.0 <= self.error_share < 1.0:
            raise ValueError(f"error_share must lie in [0, 1), got {self.error_share}")
        if self.tie_threshold < 0.0:
            raise ValueError(
                f"tie_threshold must not be negative, got {self.tie_threshold}"
            )
        if not 0.0 <= self.doubted_below < 0.5:
            raise ValueError(
                f"doubted_below must lie in [0, 0.5), got {self.doubted_below}"
            )
        if self.folds < 2:
            raise ValueError(f"folds must be at least 2, got {self.folds}")
