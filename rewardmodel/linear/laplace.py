"""Modes of a posterior over weights, and the evidence around them by Laplace.

The logarithm of the evidence is that of the likelihood and the prior at the mode, less
half the logarithm of the determinant of the Hessian there (MacKay 1992, "Bayesian
Interpolation", eq. 2.5 ff.).

Shapes: M ensemble members, B pairs, D weights, S step sizes.
"""

from __future__ import annotations

import torch
from torch import Tensor

from rewardmodel.answers.likelihood import log_likelihood_derivatives
from rewardmodel.cfg import FitCfg
from rewardmodel.prepared.described import ClipPairs

_MAX_UPDATES = 100
_STEP_SIZES = (0.0, *(2.0**-halvings for halvings in range(8)))
_TOLERANCE = 1e-4


def posterior_modes(
    inputs: Tensor,
    pairs: ClipPairs,
    counts: Tensor,
    cfg: FitCfg,
    *,
    precision: float,
    mean: Tensor | float = 0.0,
) -> Tensor:
    """Weights theta [M, D] at a mode of the posterior, by damped Newton steps from mu.

    The objective of a member is sum_b counts_b log P(answer_b | lead_b) minus
    precision / 2 |theta - mu|^2. It is not concave, because answers that look wrong
    count less and less; starting at the mean mu of the prior makes the mode a definite
    one.

    Args:
        inputs: [B, D] float64 scaled differences of the clips.
        pairs: Their answers and falls.
        counts: [M, B] float64, how often a member sees an answer.
        cfg: The likelihood of an answer.
        precision: Of the Gaussian prior on each weight.
        mean: Of the same, [D] or one for all.
    """
    target, offset = pairs.target.double(), pairs.fall_lead.double()
    sizes = torch.tensor(_STEP_SIZES, dtype=inputs.dtype)[:, None, None]
    theta = inputs.new_zeros(len(counts), inputs.shape[-1]) + mean
    for _ in range(_MAX_UPDATES):
        slope, curvature = log_likelihood_derivatives(
            theta @ inputs.mT + offset,
            target,
            tie_threshold=cfg.tie_threshold,
            error_share=pairs.errors,
        )
        pull = (counts * slope) @ inputs
        uphill = pull - precision * (theta - mean)
        if uphill.abs().max() < _TOLERANCE:
            break
        factor = hessian_factor(inputs, -counts * curvature, precision)
        step = torch.cholesky_solve(uphill[..., None], factor)[..., 0]
        tried = theta + sizes * step  # [S, M, D]
        likelihood = pairs.log_likelihood(tried @ inputs.mT + offset, cfg)
        off = (precision * (tried - mean).square()).sum(-1)
        height = (counts * likelihood).sum(-1) - off / 2
        best = height.argmax(dim=0)
        if not best.any():
            break
        theta = tried[best, torch.arange(len(theta))]
    return theta


def hessian_factor(inputs: Tensor, bends: Tensor, precision: float) -> Tensor:
    """Cholesky factor [M, D, D] of the Hessian of the negated objective, made positive
    where it is not.

    Args:
        inputs: [B, D] scaled differences of the clips.
        bends: [M, B] second derivatives of the negated log-likelihood.
        precision: Of the prior.
    """
    prior = torch.diag_embed(precision + inputs.new_zeros(inputs.shape[-1]))
    exact = (bends[..., None] * inputs).mT @ inputs + prior
    factor, failures = torch.linalg.cholesky_ex(exact)
    if not failures.any():
        return factor
    # Answers that bend the wrong way count as straight: every step climbs again.
    climbing = (bends.clamp_min(0)[..., None] * inputs).mT @ inputs + prior
    straight = torch.linalg.cholesky(climbing)
    return torch.where((failures == 0)[:, None, None], factor, straight)


def evidence(
    inputs: Tensor,
    pairs: ClipPairs,
    cfg: FitCfg,
    precision: float,
    *,
    mean: Tensor | float = 0.0,
) -> float:
    """Log of the probability of the answers, all weights averaged over.

    Args:
        inputs: [B, D] float64 scaled differences of the clips.
        pairs: Their answers and falls.
        cfg: The likelihood of an answer.
        precision: Of the Gaussian prior on each weight.
        mean: Of the same, [D] or one for all.
    """
    counts = inputs.new_ones(1, len(pairs))
    theta = posterior_modes(inputs, pairs, counts, cfg, precision=precision, mean=mean)
    leads = theta @ inputs.mT + pairs.fall_lead.double()
    _, curvature = log_likelihood_derivatives(
        leads,
        pairs.target.double(),
        tie_threshold=cfg.tie_threshold,
        error_share=pairs.errors,
    )
    factor = hessian_factor(inputs, -counts * curvature, precision)
    fitted = (counts * pairs.log_likelihood(leads, cfg)).sum(dim=-1)
    prior = precision + torch.zeros_like(theta)
    held_back = (prior * (theta - mean).square()).sum(dim=-1) / 2
    free = 2 * factor.diagonal(dim1=-2, dim2=-1).log().sum(dim=-1)
    return float(fitted - held_back - (free - prior.log().sum(dim=-1)) / 2)
