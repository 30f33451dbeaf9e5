"""What a fit says about itself."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from data.files.plain import ADDED_LATER


@dataclass(frozen=True, kw_only=True)
class FitReport:
    """How many answers there were, and how well the model foresees them.

    Accuracies count answers that prefer a clip; the model is right when its ensemble
    mean prefers the same one. Held-out answers compare two episodes the model of their
    fold has never seen.
    """

    answers: int
    """Answers used, ties included."""
    answers_without_target: int
    """Answers left out: they neither prefer a clip nor call both equal."""
    ties: int
    """Answers that call both clips equal; they are fitted but not in the accuracies."""
    train_accuracy: float | None
    """Share of the preferences the model was fitted to that it gets right."""
    train_log_likelihood: float
    """Mean over the answers, of the ensemble mean."""
    held_out_pairs: int
    """Preferences between clips of one left-out fold."""
    held_out_accuracy: float | None
    """Share of them foreseen; None when there are none."""
    held_out_interval: tuple[float, float] | None
    """Wilson 95 % interval of that share."""
    at_random_pairs: int
    """Held-out preferences whose pair was drawn at random, not chosen as hard."""
    at_random_accuracy: float | None
    """Share of these foreseen: how often the reward is right about any pair."""
    held_out_log_likelihood: float | None
    """Mean over all held-out answers, ties included."""
    temperature: float
    """What logits are divided by to be calibrated, from the held-out answers, of which
    those drawn at random count most (`rewardmodel.measures.calibration.counting`)."""
    held_out_ece: float | None
    """Expected calibration error of the held-out preferences at that temperature, as
    they count."""
    held_out_brier: float | None
    """Mean squared error of their probabilities at that temperature."""
    raters: tuple[tuple[str, float], ...] = ()
    """Share of random answers of every rater, as estimated; empty where one answered
    alone. Who hardly looks (`HARDLY_LOOKS` in `answers.likelihood`) is not
    among the held-out answers."""
    agreement: float | None = None
    """Mean rank correlation, over pairs of ensemble members, of the returns of the
    newest round's clips, or of a table's segments: 1 where no order of these is left to
    be learned."""
    open_share: float | None = None
    """Pairs of these clips of which not all members prefer the same one."""
    enough: bool = False
    """Whether more answers will not help now: members agree, and foresee answers."""
    doubted: int = field(default=0, metadata=ADDED_LATER)
    """Answers taken for random because they looked wrong (`FitCfg.label_filter`)."""
    considered: tuple[tuple[str, float], ...] = ()
    """Models that were to choose from, each with its held-out log-likelihood."""
    seconds: float = field(compare=False)
    """Wall-clock time of the fit, folds included; not saved with the model."""


def wilson_interval(right: float, total: int) -> tuple[float, float]:
    """95 % interval of a share of which `right` of `total` were seen (Wilson 1927)."""
    z = 1.959964
    share = right / total
    centre = (share + z**2 / (2 * total)) / (1 + z**2 / total)
    half = (
        z
        / (1 + z**2 / total)
        * math.sqrt(share * (1 - share) / total + z**2 / (4 * total**2))
    )
    return max(0.0, centre - half), min(1.0, centre + half)
