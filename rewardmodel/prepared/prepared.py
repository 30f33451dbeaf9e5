"""Answers as models see them: described, standardised and scaled, each of it once.

Noise level, raters, choice of a model and fit all look at the same clips. What they
look at depends on the clips alone, and not on what is believed of the answers.

Shapes: B pairs, D descriptors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

from torch import Tensor

from rewardmodel.answers.likelihood import Errors
from rewardmodel.descriptors.normaliser import Normaliser
from rewardmodel.descriptors.table import Sight, names_seen
from rewardmodel.opinions.pool import Pool

from .described import DescribedPairs, StandardisedPairs

MIN_SPREAD = 0.02
"""Spread, in standard deviations of a step, below which two clips never really differed
in a descriptor: its weight stays small instead of being divided by next to nothing."""


@dataclass(frozen=True, eq=False)
class ScaledDifferences:
    """Differences of the clips' descriptors, as a linear reward sees them."""

    inputs: Tensor
    """[B, D] float64, scaled."""
    spread: Tensor
    """[D] what they were divided by."""


class PreparedClips:
    """What is made of described clips, each when it is asked for."""

    def __init__(self, described: DescribedPairs, pool: Pool | None = None) -> None:
        self._described = described
        self.pool = pool
        self._seen: dict[int, PreparedClips] = {}

    def seen_by(self, sight: Sight) -> PreparedClips:
        """The columns of `sight`, standardised by themselves."""
        columns = len(names_seen(sight))
        if columns == self._described.steps.shape[-1]:
            # Not kept in itself, or all the steps would wait for the collector.
            return self
        if columns not in self._seen:
            self._seen[columns] = PreparedClips(self._described.seen_by(sight))
        return self._seen[columns]

    @cached_property
    def normaliser(self) -> Normaliser:
        """Fitted to the steps that count, of all there is where that is known."""
        if self.pool:
            return self.pool.normaliser
        steps = self._described.steps
        return Normaliser(steps.shape[-1]).fit(steps, self._described.scored)

    @cached_property
    def standardised(self) -> StandardisedPairs:
        """The pairs by that normaliser, with the answers they were described with."""
        return self._described.standardised(self.normaliser)

    @cached_property
    def differences(self) -> ScaledDifferences:
        """For models of weights."""
        return scaled_differences(self._described.difference(self.normaliser))


@dataclass(frozen=True, eq=False)
class Prepared:
    """Described answers and, made once, what models are fitted to."""

    described: DescribedPairs
    clips: PreparedClips

    @classmethod
    def of(cls, described: DescribedPairs, pool: Pool | None = None) -> Self:
        """Answers of which nothing is made yet."""
        return cls(described, PreparedClips(described, pool))

    def __len__(self) -> int:
        return len(self.described)

    @property
    def opinions(self) -> Tensor | None:
        """[D, D] how strong opinions about columns are expected to be that are not a
        robot's habits, as `prior_factor` gives it for those; None of those."""
        return None

    def seen_by(self, sight: Sight) -> Prepared:
        """The columns of `sight`, standardised by themselves."""
        return Prepared(self.described.seen_by(sight), self.clips.seen_by(sight))

    def with_errors(self, errors: Errors) -> Prepared:
        """These clips and answers, of raters who err as `errors` say."""
        return replace(self, described=replace(self.described, errors=errors))

    def subset(self, chosen: Tensor) -> Prepared:
        """The pairs marked in `chosen` [B] (bool), standardised by their own steps."""
        if chosen.all():
            return self
        return self.of(self.described.subset(chosen), self.clips.pool)

    @property
    def standardised(self) -> StandardisedPairs:
        """The pairs by their own steps."""
        errors = self.described.errors
        return replace(self.clips.standardised, errors=errors)

    def by(self, normaliser: Normaliser) -> StandardisedPairs:
        """The pairs by any normaliser, which may be fitted to more than these."""
        if normaliser is self.clips.normaliser:
            return self.standardised
        return self.described.standardised(normaliser)


def scaled_differences(difference: Tensor) -> ScaledDifferences:
    """Each descriptor's difference [B, D] by its root mean square over the asked pairs,
    so that a prior means the same for each: a habit in which the clips differ by the
    usual amount shifts the logit by about one."""
    difference = difference.double()
    spread = difference.square().mean(dim=0).sqrt().clamp_min(MIN_SPREAD)
    return ScaledDifferences(difference / spread, spread)
