"""Which model the evidence speaks for: by held-out answers, never by fitted ones.

Shapes: B held-out answers.
"""

from __future__ import annotations

from collections.abc import Mapping

from torch import Tensor

from .cfg import Kind

MIN_HELD_OUT = 30
"""Held-out answers below which the stiffest model is taken unseen."""
FEW_HELD_OUT = 20
"""The same where stiff weights failed and the other model picks few of many."""


def choose_kind(
    log_likelihoods: Mapping[Kind, Tensor],
    *,
    errors: float = 1.0,
    least: int = MIN_HELD_OUT,
) -> Kind:
    """The model to take, given the log-likelihood [B] of the same held-out answers.

    A more flexible model must foresee them better than the one taken so far by more
    than `errors` standard errors of the difference: a draw goes to the stiffer one.

    Args:
        log_likelihoods: By kind, from the stiffest to the most flexible.
        errors: How sure one wants to be.
        least: Answers needed to choose at all.
    """
    kinds = iter(log_likelihoods)
    chosen = next(kinds)
    for kind in kinds:
        gain = log_likelihoods[kind] - log_likelihoods[chosen]
        if len(gain) < least:
            break
        error = gain.std() / len(gain) ** 0.5
        if gain.mean() > errors * error:
            chosen = kind
    return chosen
