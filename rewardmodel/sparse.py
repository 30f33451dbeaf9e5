"""A sum of curves, one for every descriptor, of which the answers pick few.

A wish about a walk that is there already is about one or two habits, and hardly ever a
straight line: a trunk carried *so* low, one foot held *so* high. The reward of a step
is a sum of smooth curves, one of each descriptor, of which each member takes those its
answers speak for (`rewardmodel.forward`). All others are nothing, however many
descriptors there are, so this model sees the legs one by one and the stride rate too.

Shapes: M ensemble members, B pairs, T steps, D descriptors, G curves (D and the stride
rate's), W weights of a curve, P = G W.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .clips import PAST_STEPS
from .descriptors import columns_seen, names_seen
from .legs import CONTACTS
from .scorer import Additive, SequenceScorer
from .stride_rate import stride_rate
from .training import StandardisedPairs

CENTRES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Of the bumps a curve is made of besides a straight line, on the judged range, each as
wide as they are apart."""
WEIGHTS = 1 + len(CENTRES)
_RATES = (0.5, 1.75)
"""Range of the stride rate, in its median: a foot that chatters on the ground has many
times the rate of a walk, and on a range up to there all walks are alike."""
_RANGE_QUANTILE = 0.01
"""Judged steps left out at either end of the range of a descriptor. Beyond it a curve
is flat: from a crouch nobody was shown, no answer says whether it is too low."""
_ROOT_FROM = 0.01
"""Added to a share of the judged range before its root is taken."""
_IS_CONTACT = torch.tensor(
    [name in {item.name for item in CONTACTS} for name in names_seen("legs")]
)


class SparseScorer(SequenceScorer):
    """Weights of all members over the curves of all descriptors."""

    history_steps = PAST_STEPS

    def __init__(self, num_members: int, num_descriptors: int) -> None:
        super().__init__()
        self.weights: Tensor
        self.rate_mean: Tensor
        self.rate_std: Tensor
        self.judged: Tensor
        """[2, G] the range of each descriptor in the judged clips"""
        self.quadratic: Tensor
        """[G] bool, what is laid out by its root"""
        total = (num_descriptors + 1) * WEIGHTS
        self.register_buffer("weights", torch.zeros(num_members, total))
        self.register_buffer("rate_mean", torch.zeros(()))
        self.register_buffer("rate_std", torch.ones(()))
        self.register_buffer("judged", torch.zeros(2, num_descriptors + 1))
        laid_out = [column.quadratic for column in columns_seen("legs")]
        quadratic = torch.tensor([*laid_out, False])
        self.register_buffer("quadratic", quadratic, persistent=False)

    def look_at(self, pairs: StandardisedPairs) -> None:
        """Take from `pairs` what standardises the stride rate, and what was judged."""
        rate = stride_rate(
            pairs.steps, scored=pairs.scored, before=pairs.lift_offs_before
        )[pairs.scored]
        std, mean = torch.std_mean(rate, correction=0)
        self.rate_mean.copy_(mean)
        self.rate_std.copy_(std if std > 1e-6 else torch.ones(()))
        low, high = (share * rate.median() for share in _RATES)
        rate = (rate.clamp(low, high) - self.rate_mean) / self.rate_std
        seen = torch.cat([pairs.scored_steps, rate[:, None]], dim=-1).sort(dim=0).values
        last = len(seen) - 1
        ends = [round(share * last) for share in (_RANGE_QUANTILE, 1 - _RANGE_QUANTILE)]
        self.judged.copy_(seen[ends])

    def places(
        self,
        steps: Tensor,
        starts: Tensor | None = None,
        *,
        scored: Tensor | None = None,
        before: Tensor | None = None,
    ) -> Tensor:
        """[..., T, G] where on its judged range, from 0 to 1, what has a curve is, or
        how far beyond, for standardised sequences [..., T, D]. Of squares it is the
        root, as nearly all of a gait would lie at the low end of its curve."""
        rate = stride_rate(steps, starts, scored=scored, before=before)
        rate = (rate - self.rate_mean) / self.rate_std
        return self._on_range(torch.cat([steps, rate[..., None]], dim=-1))

    @property
    def average(self) -> Tensor:
        """[G] where a step is that is average in everything, from 0 to 1."""
        return self._on_range(torch.zeros_like(self.judged[0])).clamp(0, 1)

    def agreed(self) -> SparseScorer:
        """What is paid: one member whose curves are the mean ones, each the lower the
        fewer members have it.

        A curve that few answers more or less bring and take away stands for another: a
        policy whose rate of steps is right can still have more lift-offs. How often
        something is chosen from resampled answers tells what is there from what fits by
        chance (stability selection, Meinshausen and Bühlmann 2010). Where all who have
        a curve are of one mind, the share of them is what is left of the mean by least
        squares: its square beside its square and the members' variance.
        """
        weights = self.weights.unflatten(1, (-1, WEIGHTS))
        share = (weights != 0).any(dim=-1).to(weights.dtype).mean(dim=0)
        one = self.like(1)
        one.weights = (weights.mean(dim=0) * share[:, None]).flatten()[None]
        return one

    def like(self, num_members: int) -> SparseScorer:
        """As many members without any opinion, on the same ranges."""
        other = SparseScorer(num_members, len(self.quadratic) - 1)
        other.rate_mean, other.rate_std = self.rate_mean, self.rate_std
        other.judged, other.quadratic = self.judged, self.quadratic
        return other

    @property
    def payer(self) -> SparseScorer:
        """What the members agree on."""
        return self.agreed()

    @property
    def heights(self) -> Tensor:
        """[G] how much each curve, the stride rate's last, makes of the judged range:
        between its highest and its lowest point, in the mean over the members."""
        shares = torch.linspace(0, 1, 2 * len(CENTRES) - 1, device=self.judged.device)
        worth = self.along(shares[:, None].expand(-1, self.judged.shape[1])).mean(dim=0)
        return worth.amax(dim=0) - worth.amin(dim=0)

    def forward(
        self,
        steps: Tensor,
        starts: Tensor | None = None,
        *,
        scored: Tensor | None = None,
        before: Tensor | None = None,
    ) -> Tensor:
        """Raw rewards [M, ..., T] of standardised sequences [..., T, D], as in
        `stride_rate`."""
        places = self.places(steps, starts, scored=scored, before=before)
        return self.paid(places.clamp(0, 1))

    def of_clips(
        self, steps: Tensor, scored: Tensor | None, before: Tensor | None
    ) -> Tensor:
        return self(steps, scored=scored, before=before)

    def hiding(self, steps: Tensor, hidden: Tensor, before: Tensor | None) -> Tensor:
        """With the contacts, the stride rate is an average one too."""
        rate = (hidden & _IS_CONTACT).any().reshape(1)
        seen = self.places(steps, before=before).clamp(0, 1)
        return self.paid(torch.where(torch.cat([hidden, rate]), self.average, seen))

    def of_average(self, num_descriptors: int) -> Tensor:
        return self.paid(self.average)

    def additive(self, places: Tensor, low: Tensor, high: Tensor) -> Additive:
        """On the judged ranges, and of the stride rate too."""
        low, high = self.judged
        values = low + places * (high - low)
        added = self.along(places.expand(-1, values.shape[1]))
        return Additive(values, added, (self.rate_mean, self.rate_std))

    def paid(self, seen: Tensor) -> Tensor:
        """Raw rewards [M, ..., T] for `places` within what was judged,
        [..., T, G]."""
        weights = self.weights.unflatten(1, (-1, WEIGHTS))
        used = weights.abs().sum(dim=(0, 2)) > 0
        parts = curves(seen[..., used])
        return (parts @ weights[:, used].flatten(1).mT).movedim(-1, 0)

    def along(self, shares: Tensor) -> Tensor:
        """What each curve adds to the raw reward, [M, K, G], at `shares` [K, G] of the
        judged range."""
        return self.at(self._laid_out(shares.clamp(0, 1)))

    def at(self, seen: Tensor) -> Tensor:
        """The same at places [K, G] within what was judged."""
        weights = self.weights.unflatten(1, (-1, WEIGHTS))
        parts = curves(seen).unflatten(1, (-1, WEIGHTS))
        return (parts * weights[:, None]).sum(dim=-1)

    def _on_range(self, standardised: Tensor) -> Tensor:
        low, high = self.judged
        return self._laid_out((standardised - low) / (high - low).clamp_min(1e-6))

    def _laid_out(self, shares: Tensor) -> Tensor:
        return torch.where(self.quadratic, _root(shares.clamp_min(0)), shares)


def _root(shares: Tensor) -> Tensor:
    """Of shares from 0 on; 1 stays 1, and it is no steeper at 0 than a gradient
    bears."""
    low, high = _ROOT_FROM**0.5, (1 + _ROOT_FROM) ** 0.5
    return ((shares + _ROOT_FROM).sqrt() - low) / (high - low)


def curves(seen: Tensor) -> Tensor:
    """Lines and bumps [..., G W] of descriptors [..., G] on their judged range."""
    seen = seen[..., None]
    off = (seen - seen.new_tensor(CENTRES)) / (CENTRES[1] - CENTRES[0])
    bumps = (-0.5 * off.square()).exp()
    return torch.cat([seen, bumps], dim=-1).flatten(-2)
