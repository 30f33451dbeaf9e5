"""Whether the answers of a run err, decided once.

The first fit finds how many of its answers are random: a linear one by the evidence for
each share (`rewardmodel.linear.noise_level`), a posterior as the median of its
particles. Where they are more than can be overlooked, the answers err, and everything
that depends on it does so for the whole run.
"""

from __future__ import annotations

from dataclasses import dataclass

from rewardmodel.linear.noise_level import FEW_ERRORS, takes_to_err
from rewardmodel.models.model import RewardModel


@dataclass(frozen=True, kw_only=True)
class NoisyAnswers:
    """What was decided, and why."""

    noisy: bool
    """Whether answers are taken to err."""
    error_share: float
    """Share of them that the fit took to be random."""
    answers: int
    """Answers it was fitted to."""

    @classmethod
    def of(cls, model: RewardModel) -> NoisyAnswers:
        """The decision by the first reward of a run."""
        provenance = model.provenance
        return cls(
            noisy=takes_to_err(provenance.cfg),
            error_share=provenance.cfg.error_share,
            answers=provenance.report.answers,
        )

    def __str__(self) -> str:
        if self.noisy:
            return (
                f"the answers err: {self.error_share:.0%} of the first {self.answers} "
                f"look random, more than {FEW_ERRORS:.0%}"
            )
        return (
            f"the answers hardly err: {self.error_share:.0%} of the first "
            f"{self.answers} look random, no more than {FEW_ERRORS:.0%}"
        )
