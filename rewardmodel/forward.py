"""Which curves matter: taken one by one, as long as the evidence grows.

Each member takes, again and again, the curve that explains its answers best beside
those it has, and stops where the next is not worth it: forward selection by the
marginal likelihood, as in Tipping and Faul 2003 ("Fast marginal likelihood maximisation
for sparse Bayesian models"), which is Laplace's here. Members take different ones where
their answers leave that open: a curve that none of them has is never asked about.

Shapes: M ensemble members, B pairs, C candidates, V strengths, K curves, W weights of a
curve, P = G W weights of all curves, R rows of a batch.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from .cfg import FitCfg
from .laplace import log_evidence, posterior_modes
from .training import ClipPairs

LEFT_OUT = 1e-4
"""Variance of the weights of what does not matter: next to none."""
STRENGTHS = (1.0, 10.0, 100.0)
"""Variances of a straight line's weight that are tried, of all curves of a member
alike, where a unit shifts a pair by the usual amount."""
_BENT = 0.3
"""Variance of a bump's weight beside that of the line: most wishes are nearly
straight."""
PRICE = 2.0
"""Logarithm of the odds against one more curve."""
MOST = 6
"""Curves a member takes."""
_UPDATES = 12
"""Newton steps of a candidate, from the weights of the curves taken so far: two that
cannot be told apart by then are as good."""
_AT_ONCE = 4_000_000
"""Numbers of a batch, 32 MB."""


def chosen_curves(
    curves: Tensor,
    pairs: ClipPairs,
    counts: Tensor,
    cfg: FitCfg,
    *,
    allowed: Tensor,
) -> tuple[Tensor, Tensor]:
    """Weights [M, P] of the curves that matter, and their variances [M, P].

    Args:
        curves: [B, G, W] float64 scaled differences of the clips' curves, the straight
            line of each first.
        pairs: Their answers and falls.
        counts: [M, B] float64, how often a member sees an answer.
        cfg: The likelihood of an answer.
        allowed: [C] indices of the curves that may matter.
    """
    shape = prior_shape(curves)
    theta = curves.new_zeros(len(counts), *curves.shape[1:])
    variance = torch.full_like(theta, LEFT_OUT)
    nothing = pairs.log_likelihood(pairs.fall_lead.double().expand_as(counts), cfg)
    best = (counts * nothing).sum(dim=-1)
    taken = torch.empty(len(counts), 0, dtype=torch.long)
    own = curves.new_empty(len(counts), 0)
    going = torch.arange(len(counts))
    while len(going) and taken.shape[1] < min(MOST, len(allowed)):
        found, modes, which, strength = _next(
            curves, pairs, counts[going], cfg, allowed, taken, own, shape
        )
        better = found - PRICE > best[going]
        going, which, own = going[better], which[better], modes[better]
        best[going] = found[better]
        taken = torch.cat([taken[better], which[:, None]], dim=1)
        rows = going[:, None]
        theta[rows, taken] = own.unflatten(1, (taken.shape[1], -1))
        variance[rows, taken] = strength[better, None, None] * shape
    theta, variance = theta.flatten(1), variance.flatten(1)
    modes = posterior_modes(
        curves.flatten(1), pairs, counts, cfg, precision=1 / variance, start=theta
    )
    return modes.where(variance > LEFT_OUT, 0.0), variance


def _next(
    curves: Tensor,
    pairs: ClipPairs,
    counts: Tensor,
    cfg: FitCfg,
    allowed: Tensor,
    taken: Tensor,
    theta: Tensor,
    shape: Tensor,
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The best curve beside those `taken` [M, K], with weights `theta` [M, K W], for
    each member.

    Returns:
        The evidence [M], the modes [M, (K + 1) W], the curve [M] and its strength [M].
    """
    strengths = torch.tensor(STRENGTHS, dtype=curves.dtype)
    members, options = len(counts), len(allowed) * len(strengths)
    each = allowed.expand(members, -1)
    sets = torch.cat(
        [taken[:, None].expand(-1, len(allowed), -1), each[..., None]], dim=-1
    )  # [M, C, K + 1]
    sets = sets.repeat_interleave(len(strengths), dim=1).flatten(0, 1)  # [R, K + 1]
    prior = strengths.repeat(members * len(allowed))[:, None] * shape.repeat(
        sets.shape[1]
    )
    seen = counts.repeat_interleave(options, dim=0)
    before = functional.pad(theta, (0, curves.shape[2]))
    before = before.repeat_interleave(options, dim=0)
    evidence, modes = evidence_of(
        curves, pairs, seen, cfg, sets=sets, precision=1 / prior, start=before
    )
    again = (taken[:, :, None] == allowed).any(dim=1)
    again = again.repeat_interleave(len(strengths), dim=1)
    evidence = evidence.view(members, options).masked_fill(again, -torch.inf)
    best = evidence.argmax(dim=1)
    rows = torch.arange(members)
    return (
        evidence[rows, best],
        modes.view(members, options, -1)[rows, best],
        allowed[best // len(strengths)],
        strengths[best % len(strengths)],
    )


def evidence_of(
    curves: Tensor,
    pairs: ClipPairs,
    counts: Tensor,
    cfg: FitCfg,
    *,
    sets: Tensor,
    precision: Tensor,
    start: Tensor,
) -> tuple[Tensor, Tensor]:
    """Logarithm of the evidence [R] for sets of curves, and the modes [R, K W] of their
    weights.

    Args:
        curves: [B, G, W] as of `chosen_curves`.
        pairs: Their answers and falls.
        counts: [R, B] float64, how often each answer is seen.
        cfg: The likelihood of an answer.
        sets: [R, K] indices of curves.
        precision: [R, K W] of the prior on their weights.
        start: [R, K W] where to start looking for the modes.
    """
    size = curves.shape[0] * precision.shape[1]
    evidences, modes = [], []
    for part in torch.arange(len(sets)).split(max(1, _AT_ONCE // size)):
        inputs = curves[:, sets[part]].transpose(0, 1).flatten(2)  # [R, B, K W]
        own = precision[part]
        found = posterior_modes(
            inputs,
            pairs,
            counts[part],
            cfg,
            precision=own,
            start=start[part],
            max_updates=_UPDATES,
        )
        modes.append(found)
        evidences.append(log_evidence(inputs, pairs, counts[part], cfg, own, found))
    return torch.cat(evidences), torch.cat(modes)


def prior_shape(curves: Tensor) -> Tensor:
    """[W] variances of a curve's weights beside that of its line."""
    shape = curves.new_full((curves.shape[2],), _BENT)
    shape[0] = 1.0
    return shape
