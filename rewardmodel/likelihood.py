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

Shapes: any, as long as they broadcast; B pairs, M ensemble members.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor


def answer_log_probabilities(
    logit: Tensor, *, tie_threshold: float, error_share: float
) -> tuple[Tensor, Tensor, Tensor]:
    """Logarithms of P'(left), P'(right) and P'(tie), each shaped like `logit`.

    Args:
        logit: lead of the left clip.
        tie_threshold: d >= 0, the lead at which a rater starts to see a difference.
        error_share: e in [0, 1), the share of random answers.
    """
    left = _log_sigmoid(logit - tie_threshold)
    right = _log_sigmoid(-logit - tie_threshold)
    if tie_threshold == 0.0:
        tie = torch.full_like(logit, -math.inf)
        return _mixed(left, error_share, 2), _mixed(right, error_share, 2), tie
    # log(e^2d - 1), written so that a large d does not overflow.
    log_odds = 2 * tie_threshold + math.log(-math.expm1(-2 * tie_threshold))
    tie = log_odds + left + right
    return (
        _mixed(left, error_share, 3),
        _mixed(right, error_share, 3),
        _mixed(tie, error_share, 3),
    )


def _log_sigmoid(values: Tensor) -> Tensor:
    """log(1 / (1 + e^-values)), exact at both ends."""
    return -torch.logaddexp(torch.zeros_like(values), -values)


def _mixed(log_probability: Tensor, error_share: float, num_answers: int) -> Tensor:
    """log((1 - e) P + e / num_answers)."""
    if error_share == 0.0:
        return log_probability
    guess = torch.full_like(log_probability, math.log(error_share / num_answers))
    return torch.logaddexp(math.log1p(-error_share) + log_probability, guess)


def log_likelihood(
    logit: Tensor, target: Tensor, *, tie_threshold: float, error_share: float
) -> Tensor:
    """Log-likelihood of graded answers, shaped like `logit` broadcast with `target`.

    A target t in [0, 1] counts as |2t - 1| of an answer for the side it leans to and as
    the rest of a tie, so that 1, 0.5 and 0 are "left", "equal" and "right" and 0.75 is
    half an answer for the left.
    """
    left, right, tie = answer_log_probabilities(
        logit, tie_threshold=tie_threshold, error_share=error_share
    )
    lean = 2 * target - 1
    sided = lean.clamp_min(0) * left + (-lean).clamp_min(0) * right
    if tie_threshold == 0.0:
        tie = (left + right) / 2
    return sided + (1 - lean.abs()) * tie


def log_likelihood_derivatives(
    logit: Tensor, target: Tensor, *, tie_threshold: float, error_share: float
) -> tuple[Tensor, Tensor]:
    """First and second derivative of `log_likelihood` in each logit."""
    logit = logit.detach().requires_grad_()
    with torch.enable_grad():
        value = log_likelihood(
            logit, target, tie_threshold=tie_threshold, error_share=error_share
        )
        (slope,) = torch.autograd.grad(value.sum(), logit, create_graph=True)
        (curvature,) = torch.autograd.grad(slope.sum(), logit)
    return slope.detach(), curvature
