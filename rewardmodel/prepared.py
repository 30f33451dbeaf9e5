"""Answers as models see them: described, standardised and scaled, each of it once.

Noise level, raters, choice of a model and fit all look at the same clips. What they
look at depends on the clips alone, and not on what is believed of the answers.

Shapes: B pairs, D descriptors, G curves (D and the stride rate's), W weights of a
curve, P = G W.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from .clips import mean_over
from .descriptors import Sight, names_seen
from .likelihood import Errors
from .normaliser import Normaliser
from .sparse import CENTRES, WEIGHTS, SparseScorer, curves
from .training import DescribedPairs, StandardisedPairs

MIN_SPREAD = 0.02
"""Spread, in standard deviations of a step, below which two clips never really differed
in a descriptor: its weight stays small instead of being divided by next to nothing."""
_AT_ONCE = 64
"""Pairs whose steps are looked at together, some 20 MB."""


@dataclass(frozen=True, eq=False)
class ScaledDifferences:
    """Differences of the clips' descriptors, as a linear reward sees them."""

    inputs: Tensor
    """[B, D] float64, scaled."""
    spread: Tensor
    """[D] what they were divided by."""


@dataclass(frozen=True, eq=False)
class ScaledCurves:
    """Differences of the clips' curves, as a sum of curves sees them."""

    ranges: SparseScorer
    """What was judged of each descriptor, without any opinion."""
    inputs: Tensor
    """[B, P] float64, scaled."""
    units: Tensor
    """[P] what they were divided by."""


class PreparedClips:
    """What is made of described clips, each when it is asked for."""

    def __init__(self, described: DescribedPairs) -> None:
        self._described = described
        self._seen: dict[int, PreparedClips] = {described.steps.shape[-1]: self}

    def seen_by(self, sight: Sight) -> PreparedClips:
        """The columns of `sight`, standardised by themselves."""
        columns = len(names_seen(sight))
        if columns not in self._seen:
            self._seen[columns] = PreparedClips(self._described.seen_by(sight))
        return self._seen[columns]

    @cached_property
    def normaliser(self) -> Normaliser:
        """Fitted to the steps that count."""
        steps = self._described.scored_steps
        return Normaliser(steps.shape[-1]).fit(steps)

    @cached_property
    def standardised(self) -> StandardisedPairs:
        """The pairs by that normaliser, with the answers they were described with."""
        return self._described.standardised(self.normaliser)

    @cached_property
    def differences(self) -> ScaledDifferences:
        """For models of weights."""
        return scaled_differences(self.standardised)

    @cached_property
    def curves(self) -> ScaledCurves:
        """For sums of curves, which see the legs."""
        return scaled_curves(self.standardised)


@dataclass(frozen=True, eq=False)
class Prepared:
    """Described answers and, made once, what models are fitted to."""

    described: DescribedPairs
    clips: PreparedClips

    @classmethod
    def of(cls, described: DescribedPairs) -> Prepared:
        """Nothing is made yet."""
        return cls(described, PreparedClips(described))

    def __len__(self) -> int:
        return len(self.described)

    def seen_by(self, sight: Sight) -> Prepared:
        """The columns of `sight`, standardised by themselves."""
        return Prepared(self.described.seen_by(sight), self.clips.seen_by(sight))

    def with_errors(self, errors: Errors) -> Prepared:
        """The same clips and answers, of raters who err as `errors` say."""
        return replace(self, described=replace(self.described, errors=errors))

    def subset(self, chosen: Tensor) -> Prepared:
        """The pairs marked in `chosen` [B] (bool), standardised by their own steps."""
        return self if chosen.all() else Prepared.of(self.described.subset(chosen))

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


def scaled_differences(pairs: StandardisedPairs) -> ScaledDifferences:
    """Each descriptor's difference by its root mean square over the asked pairs, so
    that a prior means the same for each: a habit in which the clips differ by the usual
    amount shifts the logit by about one."""
    difference = pairs.difference.double()
    spread = difference.square().mean(dim=0).sqrt().clamp_min(MIN_SPREAD)
    return ScaledDifferences(difference / spread, spread)


def scaled_curves(pairs: StandardisedPairs) -> ScaledCurves:
    """A curve's straight line and its bumps, all together, shift a pair by the usual
    amount for one unit of weight."""
    ranges = SparseScorer(1, pairs.steps.shape[-1])
    ranges.look_at(pairs)
    parts = []
    for chosen in torch.arange(len(pairs)).split(_AT_ONCE):
        part = pairs.subset(chosen)
        before = part.lift_offs_before
        places = ranges.places(part.steps, scored=part.scored, before=before)
        values = curves(places.clamp(0, 1)).mT
        left, right = mean_over(values, part.scored[..., None, :])
        parts.append((left - right).double())
    difference = torch.cat(parts)
    squares = difference.square().mean(dim=0).unflatten(0, (-1, WEIGHTS))
    line, bumps = squares[:, :1], squares[:, 1:].sum(dim=1, keepdim=True)
    units = torch.cat([line, bumps.expand(-1, len(CENTRES))], dim=1).sqrt()
    units = units.clamp_min(MIN_SPREAD).flatten()
    return ScaledCurves(ranges, difference / units, units)
