"""What somebody may want: one to three opinions, and how reliably answers follow them.

The lead of a clip, in logits, is `sharpness (sum_j weight_j worth_j) / deviation`, with
the deviation of that sum over clips of one command.

Shapes: N hypotheses, J = 3 opinions at most, A opinions there are, B pairs of clips,
R raters.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor

from rewardmodel.opinions.opinions import ASPECT_OF_OPINION, Opinions, habit_of

SLOTS = 3
"""Opinions at most."""
ANOTHER = 0.4
"""Probability of each opinion beside the first."""
LEAST_WEIGHT = 0.3
"""Smallest weight beside the largest, 1; weights are uniform in the logarithm."""
SHARPNESS = torch.tensor([2.0, 4.0, 8.0, 16.0, 32.0])
"""Logits by which a clip leads that is better by one deviation."""
ERROR_SHARES = torch.tensor([0.02, 0.1, 0.2, 0.4, 0.7])
"""Shares of answers that are random."""
ERROR_PROBABLE = torch.tensor([0.4, 0.3, 0.2, 0.07, 0.03])
RATER_SHARES = torch.cat([ERROR_SHARES, torch.tensor([0.95])])
"""Shares of random answers of a rater who errs as often as nobody else does. Who
answers at random says now and then what would be meant."""
_LEAST_VARIANCE = 1e-3


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """N wishes that may be meant, and how those who answer err."""

    opinion: Tensor
    """[N, J] index."""
    weight: Tensor
    """[N, J], 0 where there is no such opinion; the first always is."""
    sharpness: Tensor
    """[N]."""
    error_share: Tensor
    """[N, R] of the answers of each rater."""

    def __len__(self) -> int:
        return len(self.sharpness)

    def __getitem__(self, chosen: Tensor) -> Self:
        """The hypotheses `chosen` (bool or indices)."""
        return replace(
            self,
            opinion=self.opinion[chosen],
            weight=self.weight[chosen],
            sharpness=self.sharpness[chosen],
            error_share=self.error_share[chosen],
        )

    def where(self, kept: Tensor, others: Self) -> Self:
        """These hypotheses where `kept` [N] (bool), and `others` elsewhere."""
        return replace(
            self,
            opinion=torch.where(kept[:, None], self.opinion, others.opinion),
            weight=torch.where(kept[:, None], self.weight, others.weight),
            sharpness=torch.where(kept, self.sharpness, others.sharpness),
            error_share=torch.where(
                kept[:, None], self.error_share, others.error_share
            ),
        )

    @property
    def doubled(self) -> Tensor:
        """[N] bool: has two opinions about one habit."""
        habit, on = habit_of(self.opinion), self.weight > 0
        twice = torch.zeros(len(self), dtype=torch.bool)
        for i, j in ((0, 1), (0, 2), (1, 2)):
            twice |= (habit[:, i] == habit[:, j]) & on[:, i] & on[:, j]
        return twice

    def scaled(self, opinions: Opinions) -> Tensor:
        """[N, J] weights that give sums of unit deviation over clips of one command."""
        covariance = opinions.covariance[
            self.opinion[:, :, None], self.opinion[:, None, :]
        ]
        pairs = self.weight[:, :, None] * self.weight[:, None, :]
        variance = (pairs * covariance).sum(dim=(1, 2))
        return self.weight / variance.clamp_min(_LEAST_VARIANCE).sqrt()[:, None]

    def leads(self, opinions: Opinions, difference: Tensor) -> Tensor:
        """[N, B] logit of the left of pairs, of which `difference` [A, B] says how much
        more every opinion thinks of it."""
        scaled = self.scaled(opinions) * self.sharpness[:, None]
        total = scaled[:, 0, None] * difference[self.opinion[:, 0]]
        for slot in range(1, SLOTS):
            total += scaled[:, slot, None] * difference[self.opinion[:, slot]]
        return total

    def about(self, opinions: Opinions, difference: Tensor) -> Tensor:
        """[N, P, B] which aspects what is thought of pairs is about, of which
        `difference` [A, B] says how much more every opinion thinks of the left."""
        said = self.scaled(opinions)[..., None].abs() * difference[self.opinion].abs()
        own = ASPECT_OF_OPINION[self.opinion].to(said.dtype)  # [N, J, P]
        total = torch.einsum("njb,njp->npb", said, own)
        return total / said.sum(dim=1).clamp_min(1e-9)[:, None]


def drawn(
    opinions: Opinions, prior: Prior, count: int, generator: torch.Generator
) -> Hypotheses:
    """`count` hypotheses as probable as they are before any answer."""
    weight = drawn_weights((count, SLOTS), generator)
    weight[:, 1:] *= torch.rand(count, SLOTS - 1, generator=generator) < ANOTHER
    found = Hypotheses(
        opinion=drawn_of(opinions.probable, (count, SLOTS), generator),
        weight=weight,
        sharpness=drawn_sharpness(count, generator),
        error_share=prior.drawn_shares(count, generator),
    )
    alone = found.weight * torch.tensor([1.0, 0.0, 0.0])
    return replace(
        found, weight=torch.where(found.doubled[:, None], alone, found.weight)
    )


def drawn_sharpness(count: int, generator: torch.Generator) -> Tensor:
    """[N] of hypotheses, each as probable as the others."""
    return SHARPNESS[torch.randint(len(SHARPNESS), (count,), generator=generator)]


@dataclass(frozen=True, kw_only=True)
class Prior:
    """What is expected of those who answer."""

    num_raters: int = 1
    careless: float = 0.1
    """How probable it is that one rater's share of random answers is another than the
    others'."""

    def drawn_shares(self, count: int, generator: torch.Generator) -> Tensor:
        """[N, R] shares of random answers: one is everybody's, as a wish that is hard
        to say makes all seem to err alike; who has another is an exception."""
        common = ERROR_SHARES[drawn_of(ERROR_PROBABLE, (count, 1), generator)]
        if self.num_raters == 1:
            return common
        size = (count, self.num_raters)
        own = RATER_SHARES[torch.randint(len(RATER_SHARES), size, generator=generator)]
        apart = torch.rand(size, generator=generator) < self.careless
        return torch.where(apart, own, common)

    def with_another(self, share: Tensor, generator: torch.Generator) -> Tensor:
        """[N, R] `share`, of one rater drawn anew in a way that prefers none."""
        rater = torch.randint(self.num_raters, (len(share), 1), generator=generator)
        own = torch.randint(len(RATER_SHARES), (len(share), 1), generator=generator)
        return share.scatter(1, rater, RATER_SHARES[own])

    def log_probable(self, share: Tensor) -> Tensor:
        """[N] logarithm of the prior of shares [N, R], up to a constant."""
        own = self.careless / len(RATER_SHARES)
        alike = (share[:, :, None] == ERROR_SHARES).float()  # [N, R, common]
        of_each = own + (1 - self.careless) * alike
        return (of_each.log().sum(dim=1) + ERROR_PROBABLE.log()).logsumexp(dim=1)


def drawn_of(
    probable: Tensor, size: tuple[int, ...], generator: torch.Generator
) -> Tensor:
    """Indices [*size] drawn as probable as [A]."""
    ends = probable.double().cumsum(dim=0)
    at = torch.rand(size, generator=generator, dtype=torch.float64) * ends[-1]
    return torch.searchsorted(ends, at, right=True).clamp(max=len(probable) - 1)


def drawn_weights(size: tuple[int, ...], generator: torch.Generator) -> Tensor:
    """[*size] weights, uniform in the logarithm."""
    return (torch.rand(size, generator=generator) * math.log(LEAST_WEIGHT)).exp()
