"""How likely an answer is: Bradley-Terry with ties and wrong answers, pure functions.

A clip's logit over the other is the difference of their returns. *logit > 0 means the
left clip is better*; target 1 is "left", 0 is "right", 0.5 is "equal".

Ties follow Rao and Kupper (1967), as in APReL's weak comparison: the answer is "left"
only when left leads by more than a threshold d,

    P(left) = s(logit - d),  P(right) = s(-logit - d),  s(x) = 1 / (1 + e^-x),
    P(tie)  = 1 - P(left) - P(right) = (e^2d - 1) P(left) P(right).

A share e of the answers is random, each answer on offer alike (Christiano et al. 2017):
P' = (1 - e) P + e / 3. With d = 0 a tie is not on offer: P' = (1 - e) P + e / 2, and an
answer "equal" counts as half an answer for either side.

Shapes: any, as long as they broadcast. Stacked values [3, ...] are left, right, tie.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor


def answer_log_probabilities(
    logit: Tensor, *, tie_threshold: float, error_share: float
) -> Tensor:
    """Logarithms [3, ...] of P'(left), P'(right) and P'(tie).

    Args:
        logit: lead of the left clip.
        tie_threshold: d >= 0, the lead at which a rater starts to see a difference.
        error_share: e in [0, 1), the share of random answers.
    """
    log_p = _log_probabilities(logit, tie_threshold)
    if error_share == 0.0:
        return log_p
    meant = math.log1p(-error_share) + log_p
    mixed = torch.logaddexp(meant, _log_guess(meant, tie_threshold, error_share))
    if tie_threshold == 0.0:
        mixed[2] = -math.inf
    return mixed


def log_likelihood(
    logit: Tensor, target: Tensor, *, tie_threshold: float, error_share: float
) -> Tensor:
    """Log-likelihood of graded answers, shaped like `logit` broadcast with `target`.

    A target t in [0, 1] counts as |2t - 1| of an answer for the side it leans to and as
    the rest of a tie, so that 1, 0.5 and 0 are "left", "equal" and "right" and 0.75 is
    half an answer for the left.
    """
    log_p = answer_log_probabilities(
        logit, tie_threshold=tie_threshold, error_share=error_share
    )
    return _weighted(log_p, target, tie_threshold)


def log_likelihood_derivatives(
    logit: Tensor, target: Tensor, *, tie_threshold: float, error_share: float
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
    if error_share > 0.0:
        meant = math.log1p(-error_share) + _log_probabilities(logit, tie_threshold)
        real = (meant - _log_guess(meant, tie_threshold, error_share)).sigmoid()
        bend = real * bend + real * (1 - real) * slope.square()
        slope = real * slope
    return (
        _weighted(slope, target, tie_threshold),
        _weighted(bend, target, tie_threshold),
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


def _log_guess(like: Tensor, tie_threshold: float, error_share: float) -> Tensor:
    """Logarithm of the probability that a random answer is a given one."""
    num_answers = 2 if tie_threshold == 0.0 else 3
    return torch.full_like(like, math.log(error_share / num_answers))


def _weighted(values: Tensor, target: Tensor, tie_threshold: float) -> Tensor:
    """Sum of values [3, ...] of the answers, weighted as `target` says."""
    left, right, tie = values
    if tie_threshold == 0.0:
        tie = (left + right) / 2
    lean = 2 * target - 1
    sided = lean.clamp_min(0) * left + (-lean).clamp_min(0) * right
    return sided + (1 - lean.abs()) * tie
