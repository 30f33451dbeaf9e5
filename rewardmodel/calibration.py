"""Whether a predicted probability means what it says, and how to make it so.

Only answers that prefer a clip are looked at: of a tie there is nothing to be right
about. Probability and outcome are folded onto the clip that is predicted to win, so
that a bin never mixes "surely left" with "surely right".

Shapes: B answers, S scales tried, R repetitions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

_TEMPERATURES = (0.05, 50.0)
"""Range looked at: from nearly certain to nearly no opinion."""
_PRIOR_STD = 1.5
"""Of log temperature around 0: a dozen answers that were all foreseen do not make the
model infallible."""
_ANSWERS_PER_BIN = 10
_MAX_BINS = 10
_REPETITIONS = 200


@dataclass(frozen=True)
class Bin:
    """Answers of about equal confidence."""

    confidence: float
    """Mean probability given to the clip that was predicted to win, in [0.5, 1]."""
    right: float
    """Share of these answers that were foreseen."""
    answers: int


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """How far predicted probabilities are from what happened."""

    ece: float
    """Expected calibration error: mean over the answers of |confidence - right| of
    their bin."""
    ece_by_chance: float
    """What this many answers would show if every probability were exactly right."""
    brier: float
    """Mean squared error of the probabilities; 0.25 says nothing."""
    bins: tuple[Bin, ...]
    """The reliability plot: bins of equally many answers, least confident first."""


def fit_temperature(lead: Tensor, target: Tensor) -> float:
    """The number that held-out leads [B] must be divided by to be calibrated logits.

    The most probable one under `target` [B] and a broad prior around 1; 1 without any
    preference. One number cannot overfit a few dozen answers, and keeps the order.
    """
    kept = target != 0.5
    if not kept.any():
        return 1.0
    low, high = (math.log(limit) for limit in _TEMPERATURES)
    tried = torch.linspace(low, high, 400, dtype=torch.float64)  # [S]
    logits = lead[kept].double() / tried.exp()[:, None]
    wanted = target[kept].double().expand_as(logits)
    loss = binary_cross_entropy_with_logits(logits, wanted, reduction="none")
    cost = loss.sum(dim=1) + 0.5 * (tried / _PRIOR_STD).square()
    return float(tried[cost.argmin()].exp())


def calibration(logit: Tensor, target: Tensor) -> Calibration | None:
    """How well logits [B] that left is better foretell `target` [B]; None without any
    preference."""
    kept = target != 0.5
    if not kept.any():
        return None
    probability = logit[kept].double().sigmoid()
    left = target[kept] > 0.5
    confidence = torch.maximum(probability, 1 - probability)
    right = torch.where(probability == 0.5, 0.5, ((probability > 0.5) == left).double())
    order = confidence.argsort()
    confidence, right = confidence[order], right[order]
    count = max(1, min(_MAX_BINS, len(order) // _ANSWERS_PER_BIN))
    sizes = [len(part) for part in torch.arange(len(order)).tensor_split(count)]
    bins = tuple(
        Bin(float(sure.mean()), float(hit.mean()), len(sure))
        for sure, hit in zip(confidence.split(sizes), right.split(sizes), strict=True)
    )
    return Calibration(
        ece=float(_ece(confidence, right, sizes)),
        ece_by_chance=_ece_by_chance(confidence, sizes),
        brier=float((probability - target[kept].double()).square().mean()),
        bins=bins,
    )


def _ece(confidence: Tensor, right: Tensor, sizes: list[int]) -> Tensor:
    """Expected calibration error of outcomes [..., B], in bins of `sizes`."""
    gaps = (right - confidence).split(sizes, dim=-1)
    return sum(gap.sum(dim=-1).abs() for gap in gaps) / len(confidence)  # type: ignore[return-value]


def _ece_by_chance(confidence: Tensor, sizes: list[int]) -> float:
    """Mean error of outcomes drawn with the probabilities `confidence` [B]."""
    rng = torch.Generator().manual_seed(0)
    drawn = torch.rand(_REPETITIONS, len(confidence), generator=rng)  # [R, B]
    outcomes = (drawn < confidence).double()
    return float(_ece(confidence, outcomes, sizes).mean())
