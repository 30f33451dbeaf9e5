"""The reward of a posterior: in the mean over it, a curve for every habit.

Shapes: N particles, M members, B clips, T steps, D descriptors, G habits, K nodes or
points.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from rewardmodel.answers.clip_batch import PAST_STEPS
from rewardmodel.answers.likelihood import HARDLY_LOOKS
from rewardmodel.descriptors.per_leg import CONTACTS
from rewardmodel.opinions.occupancy import NODES, along, occupancy
from rewardmodel.opinions.opinions import SHAPES, Opinions, habit_of
from rewardmodel.opinions.ranges import HABITS, Ranges, laid_out
from rewardmodel.scorer import Additive, SequenceScorer

from .hypotheses import SLOTS, Hypotheses

_ASKED = 400
"""Particles whose worths of clips are told."""
_IS_CONTACT = torch.tensor([name in {c.name for c in CONTACTS} for name in HABITS])


class CurvesScorer(SequenceScorer):
    """Sums of curves given by their values at nodes."""

    history_steps = PAST_STEPS

    def __init__(self, ranges: Ranges) -> None:
        super().__init__()
        self.ranges = ranges

    @property
    def table(self) -> Tensor:
        """[M, G, K] values of the curves of each member at the nodes."""
        raise NotImplementedError

    @property
    def heights(self) -> Tensor:
        """[G] between the highest and the lowest point on the range, in the mean over
        the members."""
        inside = (NODES >= 0) & (NODES <= 1)
        mean = self.table[..., inside.to(self.table.device)].mean(dim=0)
        return mean.amax(dim=-1) - mean.amin(dim=-1)

    def forward(
        self,
        steps: Tensor,
        starts: Tensor | None = None,
        *,
        scored: Tensor | None = None,
        before: Tensor | None = None,
    ) -> Tensor:
        places = self.ranges.places(steps, starts, scored=scored, before=before)
        return along(self.table, places)

    def of_clips(
        self, steps: Tensor, scored: Tensor | None, before: Tensor | None
    ) -> Tensor:
        return self(steps, scored=scored, before=before)

    def hiding(self, steps: Tensor, hidden: Tensor, before: Tensor | None) -> Tensor:
        """With the contacts, the stride rate is an average one too."""
        rate = (hidden & _IS_CONTACT[:-1].to(hidden.device)).any().reshape(1)
        seen = self.ranges.places(steps, before=before)
        mean = self.ranges.average
        return along(self.table, torch.where(torch.cat([hidden, rate]), mean, seen))

    def of_average(self, num_descriptors: int) -> Tensor:
        return along(self.table, self.ranges.average)

    def additive(self, places: Tensor, low: Tensor, high: Tensor) -> Additive:
        """On the ranges, and of the stride rate too."""
        low, high = self.ranges.ends
        table = self.table
        values = low + places * (high - low)
        at = laid_out(places.expand(-1, len(HABITS)))
        added = torch.stack(
            [along(_alone(table, habit), at) for habit in range(len(HABITS))],
            dim=-1,
        )
        return Additive(values, added, (self.ranges.rate_mean, self.ranges.rate_std))


class MeanScorer(CurvesScorer):
    """One member with the curves it is given."""

    def __init__(self, ranges: Ranges, table: Tensor) -> None:
        super().__init__(ranges)
        self._table = table

    @property
    def table(self) -> Tensor:
        return self._table


class PosteriorScorer(CurvesScorer):
    """Particles, of which some stand for all where members are asked."""

    def __init__(self, num_particles: int, num_members: int) -> None:
        super().__init__(Ranges())
        self.num_members = num_members
        self.opinion: Tensor
        self.weight: Tensor
        """In logits a unit of the curve as it stands."""
        self.sharpness: Tensor
        self.error_share: Tensor
        slots = (num_particles, SLOTS)
        self.register_buffer("opinion", torch.zeros(slots, dtype=torch.long))
        self.register_buffer("weight", torch.zeros(slots))
        self.register_buffer("sharpness", torch.ones(num_particles))
        self.register_buffer("error_share", torch.zeros(num_particles))
        self._tables: tuple[Tensor, MeanScorer] | None = None

    def hold(
        self,
        found: Hypotheses,
        opinions: Opinions,
        ranges: Ranges,
        answers_of: Tensor,
    ) -> None:
        """Take over what was found of raters who gave `answers_of` [R] answers."""
        self.ranges.load_state_dict(ranges.state_dict())
        scaled = found.scaled(opinions) / opinions.unit[found.opinion]
        self.opinion.copy_(found.opinion)
        self.weight.copy_(scaled * found.sharpness[:, None])
        self.sharpness.copy_(found.sharpness)
        looking = found.error_share.mean(dim=0) < HARDLY_LOOKS
        counts = answers_of * (looking if looking.any() else ~looking)
        self.error_share.copy_(found.error_share @ (counts / counts.sum()))
        self._tables = None

    def require_sound(self) -> None:
        count = len(HABITS) * len(SHAPES)
        if not ((self.opinion >= 0) & (self.opinion < count)).all():
            raise ValueError(f"opinions must lie in [0, {count})")

    @property
    def error_share_found(self) -> float:
        """Half of the particles think of more, in the mean over the answers of raters
        who look."""
        return round(float(self.error_share.median()), 3)

    def worths(
        self,
        steps: Tensor,
        scored: Tensor,
        before: Tensor | None,
        rng: np.random.Generator,
    ) -> tuple[Tensor, Tensor]:
        chosen = torch.from_numpy(rng.permutation(len(self.weight))[:_ASKED])
        places = self.ranges.places(steps, scored=scored, before=before)
        table = table_of(self.opinion[chosen], self.weight[chosen])
        worth = table.flatten(1) @ occupancy(places, scored).flatten(1).mT
        return worth, self.error_share[chosen]

    @property
    def table(self) -> Tensor:
        return self._made()[0]

    @property
    def payer(self) -> MeanScorer:
        """The mean over the particles, each with a deviation of its own, all equally
        sharp: how surely an answer follows a wish says nothing about the wish."""
        return self._made()[1]

    def _made(self) -> tuple[Tensor, MeanScorer]:
        if self._tables is None or self._tables[0].device != self.weight.device:
            every = max(1, len(self.weight) // self.num_members)
            members = table_of(self.opinion[::every], self.weight[::every])
            alike = self.weight / self.sharpness[:, None] * self.sharpness.mean()
            mean = table_of(self.opinion.view(1, -1), alike.view(1, -1))
            mean = mean / len(self.weight)
            self._tables = members, MeanScorer(self.ranges, mean)
        return self._tables


def table_of(opinion: Tensor, weight: Tensor) -> Tensor:
    """Values [M, G, K] of sums of weighted curves, of `opinion` and `weight` [M, J]."""
    shapes = SHAPES.to(weight.device)
    table = weight.new_zeros(len(weight), len(HABITS), shapes.shape[1])
    curves = weight[..., None] * shapes[opinion % len(shapes)]
    habit = habit_of(opinion)[..., None].expand_as(curves)
    return table.scatter_add_(1, habit, curves)


def _alone(table: Tensor, habit: int) -> Tensor:
    """`table` with all curves but that of one habit 0."""
    one = torch.zeros_like(table)
    one[:, habit] = table[:, habit]
    return one
