"""Settings of a fit; those of what is off by default are `rewardmodel.extensions`'."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, TypeVar, get_args

from data.files.plain import ADDED_LATER, to_plain

from .extensions_cfg import (
    MODELS,
    LabelFilterCfg,
    ModelCfg,
    SemiSupervisedCfg,
    require_members,
)


@dataclass(frozen=True, kw_only=True)
class LinearCfg:
    """The default: a reward linear in the gait descriptors."""

    REMOVED: ClassVar = ("quiet_logit", "hurry")
    """Settings that older files have: of what was expected once a robot walks."""

    num_members: int = 50
    """Models fitted to resampled answers, fewer where answers are many; their spread
    measures what is unknown."""
    prior_precision: float = 1.0
    """Precision of the Gaussian prior on each weight; larger means weaker opinions."""
    unsteady_logit: float = field(default=0.75, metadata=ADDED_LATER)
    """Logit by which a clip that bounces, sways, rocks or slips by the usual amount
    more, each, is expected to lose before any answer. Answers overrule it; wrong ones
    are kept from teaching that rocking is wanted."""
    told_most: bool = field(default=False, metadata=ADDED_LATER)
    """Where answers err, whether opinions about doing what the robot is told are
    expected to be twice as strong as others, for or against it, and of one piece, those
    about effort half as strong, and those about how the feet go a third."""

    def __post_init__(self) -> None:
        require_members(self.num_members)
        if self.prior_precision <= 0.0:
            raise ValueError(
                f"prior_precision must be positive, got {self.prior_precision}"
            )


@dataclass(frozen=True, kw_only=True)
class PosteriorCfg:
    """Particles over which one to three habits somebody wants, and how."""

    num_particles: int = 1000
    """Wishes the posterior is held by."""
    num_members: int = 50
    """Particles that stand for all where an ensemble is asked."""
    told: bool = True
    """Whether somebody may want something of how fast the robot goes and turns, and of
    how well it follows commands. Where a task pays for that, a policy cannot change it,
    and such an opinion is chance, or stands for a habit that goes with speed."""

    def __post_init__(self) -> None:
        require_members(self.num_members)
        if self.num_particles < self.num_members:
            raise ValueError(
                f"num_particles must be at least num_members {self.num_members}, got "
                f"{self.num_particles}"
            )


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


M = TypeVar("M", bound=ModelCfg)

KindName = Literal["linear", "posterior", "gp", "mlp", "history", "transformer", "raw"]
"""The models there are, from the stiffest to the most flexible."""
CHOSEN_FROM = tuple(name for name in get_args(KindName) if name != "raw")
"""What `auto` chooses from: models of habits."""
KIND_NAMES = (*get_args(KindName), "auto")
"""What may be asked for: a model, or how it is chosen."""


@dataclass(frozen=True, kw_only=True)
class FitCfg:
    """How a reward model is fitted to the answers collected so far."""

    REMOVED: ClassVar = ("sparse",)
    """Settings that older files have: of curves that were picked one by one."""

    kind: KindName | Literal["auto"] = "linear"
    """Model: `linear` in the gait descriptors, a `posterior` over one to three habits,
    a Gaussian process (`gp`) or a small network (`mlp`) on the descriptors, one on the
    last steps (`history`, `transformer`), networks on `raw` rows, or `auto`, whichever
    of all but the last foresees held-out answers best."""
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
    fall_logit: float = 3.0
    """Fixed logit against a clip that ends in a fall; it is not learned."""
    folds: int = 5
    """Groups of episodes left out in turn to measure accuracy."""
    linear: LinearCfg = LinearCfg()
    """Settings of the `linear` model."""
    posterior: PosteriorCfg = field(default=PosteriorCfg(), metadata=ADDED_LATER)
    """Settings of the `posterior` model."""
    reliability: ReliabilityCfg = ReliabilityCfg()
    """Where several raters answered."""
    models: tuple[ModelCfg, ...] = field(default=(), metadata=ADDED_LATER)
    """Settings of models that are extensions; of one that is not here, its defaults."""
    semi_supervised: SemiSupervisedCfg | None = field(
        default=None, metadata=ADDED_LATER
    )
    """How much the reward's own opinion counts; None, not at all."""
    label_filter: LabelFilterCfg | None = field(default=None, metadata=ADDED_LATER)
    """Which answers are taken for random because they look wrong; None, no answers."""

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
        given = [type(own).__name__ for own in self.models]
        if twice := {name for name in given if given.count(name) > 1}:
            raise ValueError(f"settings of {', '.join(twice)} are given twice")
        if self.folds < 2:
            raise ValueError(f"folds must be at least 2, got {self.folds}")

    def settings_of(self, model: type[M]) -> M:
        """Settings of a model that is an extension: those given, or its defaults."""
        return next((own for own in self.models if type(own) is model), model())

    @staticmethod
    def of_older(values: Mapping[str, Any]) -> dict[str, Any]:
        """What a file of an earlier version calls otherwise, as it is called now.

        Every model had settings in every file, whether it was used or not. `grow` chose
        a model, and chose `linear` in every run that is known.
        """
        new = dict(values)
        given = {cls: new.pop(name) for name, cls in MODELS.items() if name in new}
        if own := [old for cls, old in given.items() if old != to_plain(cls())]:
            new["models"] = own
        if below := new.pop("doubted_below", 0.0):
            new["label_filter"] = {"below": below}
        if new.get("kind") == "grow":
            new["kind"] = "linear"
        return new
