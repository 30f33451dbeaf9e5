"""Which curves matter: sets of few, each as probable as all answers make it.

Beside `rewardmodel.forward`, whose members each look in resampled answers of their own.
Those are two thirds of the answers, some several times, and speak for curves that all
answers do not speak for. Here what explains all of them is looked for from nothing on:
of the sets of each size the best few are kept, and tried with one curve more. One alone
would keep what it took first, though two others explain it. How probable a set is says
its evidence, and a price for each curve; the members share what is found by that
(averaging over the best models: Madigan and Raftery 1994, "Model selection and
accounting for model uncertainty in graphical models using Occam's window").

Shapes: M ensemble members, B pairs, C candidates, V strengths, K curves, W weights of a
curve, P = G W weights of all curves, R sets of one size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from .cfg import FitCfg
from .forward import LEFT_OUT, MOST, STRENGTHS, evidence_of, prior_shape
from .linear import posterior_modes
from .training import TrainingPairs

PRICE = 4.0
"""Logarithm of the odds against one more curve, of some fifty that there are."""
_WIDTH = 4
"""Sets of a size that are tried with one curve more."""
_WINDOW = 8.0
"""Logarithm of the odds from which on a set counts as nothing beside the best."""
_PATIENCE = 4.0
"""How much worse than the best so far the best sets of a size may be for longer ones to
be tried."""


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """A set of curves that may be all that the answers are about."""

    curves: tuple[int, ...]
    strength: float
    """Variance of a straight line's weight."""
    log_odds: float
    """Up to a constant: the evidence, less the price."""


def explanations(
    curves: Tensor, pairs: TrainingPairs, cfg: FitCfg, *, allowed: Tensor
) -> list[Explanation]:
    """What explains the answers, best first; that nothing does is among it.

    Args:
        curves: [B, G, W] float64 scaled differences of the clips' curves, the straight
            line of each first.
        pairs: Their answers and falls.
        cfg: The likelihood of an answer.
        allowed: [C] indices of the curves that may matter.
    """
    nothing = pairs.log_likelihood(pairs.fall_lead.double(), cfg)
    best = float(nothing.sum())
    found = [Explanation(curves=(), strength=STRENGTHS[0], log_odds=best)]
    kept: list[_Weighed] = [((), curves.new_empty(0))]
    for size in range(1, min(MOST, len(allowed)) + 1):
        longer = _longer(kept, allowed.tolist(), curves.shape[2])
        evidence, modes = _evidence(curves, pairs, cfg, longer)
        log_odds = evidence - size * PRICE
        top, which = log_odds.max(dim=1)
        if float(top.max()) < best - _PATIENCE:
            break
        best = max(best, float(top.max()))
        for taken, row in zip(longer, log_odds.tolist(), strict=True):
            found += [
                Explanation(curves=taken, strength=strength, log_odds=each)
                for strength, each in zip(STRENGTHS, row, strict=True)
                if each > best - _WINDOW
            ]
        sets = list(longer)
        order = top.argsort(descending=True)[:_WIDTH].tolist()
        kept = [(sets[row], modes[row, which[row]]) for row in order]
    found.sort(key=lambda each: -each.log_odds)
    return found


_Weighed = tuple[tuple[int, ...], Tensor]
"""A set of curves, and weights [K W] of these in its order."""


def _longer(
    kept: Sequence[_Weighed], allowed: Sequence[int], size: int
) -> dict[tuple[int, ...], Tensor]:
    """The sets with one curve more than `kept`, each once, and weights to start from,
    `size` of them 0."""
    longer: dict[frozenset[int], _Weighed] = {}
    for taken, theta in kept:
        start = functional.pad(theta, (0, size))
        for one in allowed:
            if one not in taken:
                longer.setdefault(frozenset((*taken, one)), ((*taken, one), start))
    return dict(longer.values())


def _evidence(
    curves: Tensor,
    pairs: TrainingPairs,
    cfg: FitCfg,
    sets: dict[tuple[int, ...], Tensor],
) -> tuple[Tensor, Tensor]:
    """Logarithm of the evidence [R, V] for sets of one size, in every strength, and
    their modes [R, V, K W]."""
    strengths = torch.tensor(STRENGTHS, dtype=curves.dtype)
    taken = torch.tensor(list(sets)).repeat_interleave(len(strengths), dim=0)
    start = torch.stack(list(sets.values())).repeat_interleave(len(strengths), dim=0)
    shape = prior_shape(curves).repeat(taken.shape[1])
    evidence, modes = evidence_of(
        curves,
        pairs,
        curves.new_ones(len(taken), len(pairs)),
        cfg,
        sets=taken,
        precision=1 / (strengths.repeat(len(sets))[:, None] * shape),
        start=start,
    )
    evidence = evidence.view(len(sets), -1)
    return evidence, modes.view(*evidence.shape, -1)


def shared_out(found: Sequence[Explanation], members: int) -> list[Explanation]:
    """One for each member, each as often as it is probable, by systematic draws in the
    middle of their stretches (Kitagawa 1996)."""
    log_odds = torch.tensor([each.log_odds for each in found], dtype=torch.double)
    below = log_odds.softmax(dim=0).cumsum(dim=0)
    places = (torch.arange(members, dtype=torch.double) + 0.5) / members
    which = torch.searchsorted(below, places).clamp_max(len(found) - 1)
    return [found[i] for i in which.tolist()]


def weights_of(
    chosen: Sequence[Explanation],
    curves: Tensor,
    pairs: TrainingPairs,
    counts: Tensor,
    cfg: FitCfg,
) -> tuple[Tensor, Tensor]:
    """Weights [M, P] of the curves that each member has, and their variances [M, P].

    Args:
        chosen: What each member takes for all that the answers are about.
        curves: As of `explanations`.
        pairs: Their answers and falls.
        counts: [M, B] float64, how often a member sees an answer.
        cfg: The likelihood of an answer.
    """
    variance = curves.new_full((len(chosen), *curves.shape[1:]), LEFT_OUT)
    for member, each in enumerate(chosen):
        variance[member, list(each.curves)] = each.strength * prior_shape(curves)
    variance = variance.flatten(1)
    modes = posterior_modes(
        curves.flatten(1), pairs, counts, cfg, precision=1 / variance
    )
    return modes.where(variance > LEFT_OUT, 0.0), variance
