"""What an ensemble says of pairs, and how far its members quarrel about them.

Shapes: M ensemble members, B pairs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True, eq=False)
class Prediction:
    """On pairs; `lead` says which clip, `logit` how surely."""

    lead: Tensor
    """[B] logit of what is paid that the left clips are better."""
    variance: Tensor
    """[B] of the same logit over the members."""

    @classmethod
    def of(cls, lead: Tensor, leads: Tensor) -> Prediction:
        """The prediction of a lead [B], and of the leads of the members [M, B]."""
        return cls(lead, leads.var(dim=0, correction=0))

    @classmethod
    def none(cls, count: int) -> Prediction:
        """No opinion on `count` pairs."""
        return cls(torch.zeros(count), torch.zeros(count))

    @property
    def logit(self) -> Tensor:
        """[B] of the mean of the probabilities that leads so far apart mean.

        The lead of a pair that members quarrel about says less than as large a one
        that they agree on (MacKay 1992, "The Evidence Framework Applied to
        Classification Networks", eq. 10). Questions are asked where they quarrel:
        were they taken for pairs like others, one temperature would be right for
        neither. Of a sum of curves the lead is what is paid, nearer to 0 than the
        members' mean, around which they vary: on stored runs no less right than theirs.
        """
        return self.lead / (1 + math.pi / 8 * self.variance).sqrt()

    def subset(self, kept: Tensor) -> Prediction:
        """On the pairs in `kept` [B] bool."""
        return Prediction(self.lead[kept], self.variance[kept])

    def put(self, where: Tensor, other: Prediction) -> None:
        """Take over `other` for the pairs in `where` [B] bool."""
        self.lead[where], self.variance[where] = other.lead, other.variance


def as_answered(logit: Tensor, error_share: float) -> Tensor:
    """Logit [...] that left is called better, where it is with `logit` [...] and a
    share of the answers is random: however clear a pair, some are wrong about it."""
    if error_share == 0.0:
        return logit
    meant = (1 - error_share) * logit.double().sigmoid()
    return (meant + error_share / 2).logit().to(logit.dtype)
