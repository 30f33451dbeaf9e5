"""How likely an answer is: Bradley-Terry with ties and wrong answers, pure functions.

A clip's logit over the other is the difference of their returns. *logit > 0 means the
left clip is better*; target 1 is "left", 0 is "right", 0.5 is "equal".

Ties follow Rao and Kupper (1967), as in APReL's weak comparison: the answer is "left"
only when left leads by more than a threshold d,

    P(left) = s(logit - d),  P(right) = s(-logit - d),  s(x) = 1 / (1 + e^-x),
    P(tie)  = 1 - P(left) - P(right) = (e^2d - 1) P(left) P(right).

A share e of the answers is random, each answer on offer alike (Christiano et al. 2017):
P' = (1 - e) P + e / 3. With d = 0 a tie is not on offer: P' = (1 - e) P + e / 2, and an
answer "equal" counts as half an answer for either side. Share and guesses may differ
from answer to answer, as where some raters are more reliable than others.

Shapes: any, as long as they broadcast. Stacked values [3, ...] are left, right, tie.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

_USUAL = 10.0
"""Answers, as many of each kind, that are expected of a rater besides those given."""


HARDLY_LOOKS = 0.7
"""Share of random answers from which on those of a rater do not measure a reward."""


@dataclass(frozen=True, eq=False)
class Errors:
    """How the answers that are not meant come about."""

    share: Tensor
    """[B] in [0, 1), of the answers that are random."""
    guess: Tensor
    """[3, B] how often a random answer is left, right, tie."""
    rater: Tensor
    """[B] number of who answered."""

    @staticmethod
    def alike(share: float, count: int, *, tie_threshold: float) -> Errors:
        """One share for all, and each answer on offer as likely as the others."""
        offered = [0.5, 0.5, 0.0] if tie_threshold == 0.0 else [1 / 3, 1 / 3, 1 / 3]
        guess = torch.tensor(offered)[:, None].expand(3, count)
        rater = torch.zeros(count, dtype=torch.long)
        return Errors(torch.full((count,), share), guess, rater)

    def joined(self, others: Errors) -> Errors:
        """These, and those of other answers behind them."""
        return Errors(
            torch.cat([self.share, others.share]),
            torch.cat([self.guess, others.guess], dim=1),
            torch.cat([self.rater, others.rater]),
        )

    def part(self, chosen: Tensor | slice) -> Errors:
        """Those of the answers `chosen` [B] (bool or indices)."""
        return Errors(self.share[chosen], self.guess[:, chosen], self.rater[chosen])


def guesses_of(
    target: Tensor, of: Tensor, num_raters: int, *, tie_threshold: float
) -> Tensor:
    """How often each rater says left, right and equal, [3, R].

    Args:
        target: [B] probability that the left clip is better.
        of: [B] number of who answered.
        num_raters: R.
        tie_threshold: As above.
    """
    said = answer_weights(target, tie_threshold=tie_threshold)
    alike = Errors.alike(0.0, num_raters, tie_threshold=tie_threshold).guess
    sums = (_USUAL * alike).index_add(1, of, said)
    return sums / sums.sum(dim=0)


def answer_log_probabilities(
    logit: Tensor, *, tie_threshold: float, error_share: float | Errors
) -> Tensor:
    """Logarithms [3, ...] of P'(left), P'(right) and P'(tie).

    Args:
        logit: lead of the left clip.
        tie_threshold: d >= 0, the lead at which a rater starts to see a difference.
        error_share: e in [0, 1), the share of random answers; or share and guesses of
            every answer, which broadcast with `logit`.
    """
    log_p = _log_probabilities(logit, tie_threshold)
    if error_share == 0.0:
        return log_p
    meant = _log_meant(log_p, error_share)
    mixed = torch.logaddexp(meant, _log_guess(meant, tie_threshold, error_share))
    if tie_threshold == 0.0:
        mixed[2] = -math.inf
    return mixed


def log_likelihood(
    logit: Tensor,
    target: Tensor,
    *,
    tie_threshold: float,
    error_share: float | Errors,
) -> Tensor:
    """Log-likelihood of graded answers, shaped like `logit` broadcast with `target`.

    A target t in [0, 1] counts as |2t - 1| of an answer for the side it leans to and as
    the rest of a tie, so that 1, 0.5 and 0 are "left", "equal" and "right" and 0.75 is
    half an answer for the left.
    """
    log_p = answer_log_probabilities(
        logit, tie_threshold=tie_threshold, error_share=error_share
    )
    return weighted(log_p, target, tie_threshold)


def log_likelihood_derivatives(
    logit: Tensor,
    target: Tensor,
    *,
    tie_threshold: float,
    error_share: float | Errors,
) -> tuple[Tensor, Tensor]:
    """First and second derivative of `log_likelihood` in each logit.

    With s = d log P / d logit and q = (1 - e) P / P', the share of the answers that are
    not random, the derivatives of log P' are q s and q s' + q (1 - q) s^2.
    """
    below = (tie_threshold - logit).sigmoid()
    above = (tie_threshold + logit).sigmoid()
    slope = torch.stack([below, -above, below - above])
    bends = torch.stack([below * (below - 1), above * (above - 1)])
    bend = torch.cat([bends, bends.sum(dim=0, keepdim=True)])
    if error_share != 0.0:
        meant = _log_meant(_log_probabilities(logit, tie_threshold), error_share)
        real = (meant - _log_guess(meant, tie_threshold, error_share)).sigmoid()
        bend = real * bend + real * (1 - real) * slope.square()
        slope = real * slope
    return (
        weighted(slope, target, tie_threshold),
        weighted(bend, target, tie_threshold),
    )


def _log_probabilities(logit: Tensor, tie_threshold: float) -> Tensor:
    """Logarithms [3, ...] of the probabilities of answers that are not random."""
    left = _log_sigmoid(logit - tie_threshold)
    right = _log_sigmoid(-logit - tie_threshold)
    if tie_threshold == 0.0:
        return torch.stack([left, right, torch.full_like(logit, -math.inf)])
    # log(e^2d - 1), written so that a large d does not overflow.
    log_odds = 2 * tie_threshold + math.log(-math.expm1(-2 * tie_threshold))
    return torch.stack([left, right, log_odds + left + right])


def _log_sigmoid(values: Tensor) -> Tensor:
    """log(1 / (1 + e^-values)), exact at both ends."""
    return -torch.logaddexp(torch.zeros_like(values), -values)


def answer_weights(target: Tensor, *, tie_threshold: float) -> Tensor:
    """How much of a left, a right and a tied answer [3, B] each target [B] is."""
    one = torch.eye(3, dtype=target.dtype)[:, :, None]
    return torch.stack([weighted(row, target, tie_threshold) for row in one])


def _log_meant(log_p: Tensor, error_share: float | Errors) -> Tensor:
    """Logarithm of the probability that an answer is meant, and a given one."""
    if isinstance(error_share, Errors):
        return torch.log1p(-error_share.share.to(log_p.dtype)) + log_p
    return math.log1p(-error_share) + log_p


def _log_guess(
    like: Tensor, tie_threshold: float, error_share: float | Errors
) -> Tensor:
    """Logarithm of the probability that an answer is random, and a given one."""
    if isinstance(error_share, Errors):
        random = error_share.guess * error_share.share
        while random.ndim < like.ndim:
            random = random[:, None]
        return random.to(like.dtype).log().expand_as(like)
    num_answers = 2 if tie_threshold == 0.0 else 3
    return torch.full_like(like, math.log(error_share / num_answers))


def weighted(values: Tensor, target: Tensor, tie_threshold: float) -> Tensor:
    """Sum of values [3, ...] of the answers, weighted as `target` says."""
    left, right, tie = values
    if tie_threshold == 0.0:
        tie = (left + right) / 2
    lean = 2 * target - 1
    sided = lean.clamp_min(0) * left + (-lean).clamp_min(0) * right
    return sided + (1 - lean.abs()) * tie
