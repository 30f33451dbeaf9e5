"""What opinions are about: the clips there are, and what curves make of them.

Shapes: C clips, T steps, D descriptors, L steps before a clip, A opinions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from rewardmodel.answers.answered_pairs import AnsweredPairs
from rewardmodel.answers.recorded import RecordedClips
from rewardmodel.descriptors.normaliser import Normaliser, fill_missing
from rewardmodel.descriptors.table import describe

from .occupancy import occupancy
from .opinions import Opinions
from .ranges import Ranges


@dataclass(frozen=True)
class Pool:
    """Clips, described; what is made of them is made once."""

    steps: Tensor
    """[C, T, D] raw descriptors, NaN where nobody measured."""
    scored: Tensor
    """[C, T] bool."""
    before: Tensor | None
    """[C, L] lift-offs."""
    command: Tensor
    """[C] equal where the robot was told the same."""
    told: bool
    """Whether speeds and errors are among the habits, as `PosteriorCfg` says."""

    @classmethod
    def of(cls, pairs: AnsweredPairs, *, told: bool) -> Pool:
        """What was recorded, or, where nobody knows, the judged clips."""
        recorded = pairs.recorded or _judged(pairs)
        clips = recorded.clips
        return cls(
            describe(clips.features, "legs"),
            clips.scored,
            clips.lift_offs_before,
            recorded.command,
            told,
        )

    @cached_property
    def normaliser(self) -> Normaliser:
        """Fitted to the steps that count."""
        steps = self.steps[self.scored]
        return Normaliser(steps.shape[-1]).fit(steps)

    @cached_property
    def _standardised(self) -> Tensor:
        return fill_missing(self.normaliser(self.steps))

    @cached_property
    def ranges(self) -> Ranges:
        """Ranges of every habit."""
        return Ranges().look_at(self._standardised, self.scored, self.before)

    @cached_property
    def occupied(self) -> Tensor:
        """[C, G, K] where on these the clips spend their time."""
        return self.occupancy_of(self._standardised, self.scored, self.before)

    @cached_property
    def opinions(self) -> Opinions:
        """What can be thought of them."""
        return Opinions.of(self.occupied, self.command, told=self.told)

    def occupancy_of(
        self, steps: Tensor, scored: Tensor, before: Tensor | None
    ) -> Tensor:
        """[B, G, K] of other clips, standardised [B, T, D]."""
        places = self.ranges.places(steps, scored=scored, before=before)
        return occupancy(places, scored)


def _judged(pairs: AnsweredPairs) -> RecordedClips:
    """The clips on both sides of all pairs."""
    _, told = pairs.commands.unique(dim=0, return_inverse=True)
    return RecordedClips(pairs.left.joined(pairs.right), torch.cat([told, told]))
