"""What a reward may be made of, and how probable it makes the answers.

Shapes: B pairs, P weights.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from torch import Tensor

from .cfg import FitCfg
from .laplace import evidence
from .noise_level import PRECISIONS, expected_of_all
from .prepared import Prepared
from .training import ClipPairs


@dataclass(frozen=True, kw_only=True, eq=False)
class Hypothesis:
    """Weights that there may be, and what is expected of them before any answer."""

    inputs: Tensor
    """[B, P] float64 scaled differences of the clips."""
    precision: Tensor | float
    """Of the Gaussian prior on each weight, [P] or one for all."""
    mean: Tensor | float = 0.0
    """Of the same."""
    start: Tensor | None = None
    """[1, P] where to start looking for the weights, if not at the mean."""
    price: float = 0.0
    """Logarithm of the odds against these weights rather than others."""

    def log_odds(self, pairs: ClipPairs, cfg: FitCfg) -> float:
        """Of these weights and the answers of `pairs`, up to a constant."""
        if not self.inputs.shape[1]:
            leads = pairs.fall_lead.double()
            return float(pairs.log_likelihood(leads, cfg).sum()) - self.price
        found = evidence(
            self.inputs,
            pairs,
            cfg,
            self.precision,
            mean=self.mean,
            start=self.start,
        )
        return found - self.price


Explain = Callable[[ClipPairs], Hypothesis]
"""Finds what explains answers best that err as often as those it is given."""


def linear_hypothesis(prepared: Prepared, cfg: FitCfg) -> Explain:
    """How to explain answers by weights."""
    inputs, mean = prepared.clips.differences.inputs, expected_of_all(prepared, cfg)

    def explain(answered: ClipPairs) -> Hypothesis:
        tried = [
            Hypothesis(inputs=inputs, precision=precision, mean=mean)
            for precision in PRECISIONS
        ]
        return max(tried, key=lambda each: each.log_odds(answered, cfg))

    return explain
