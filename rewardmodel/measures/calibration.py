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

from rewardmodel.models.prediction import as_answered

_TEMPERATURES = (0.05, 50.0)
"""Range looked at: from nearly certain to nearly no opinion."""
_PRIOR_STD = 1.5
"""Deviation of log temperature around 0 before any answer: a dozen answers that were
all foreseen do not make the model infallible."""
_CHOSEN = 0.1
"""What an answer to a chosen question counts beside one drawn at random."""
_ENOUGH_AT_RANDOM = 10
"""Answers drawn at random below which all answers count alike."""
_ANSWERS_PER_BIN = 10
_MAX_BINS = 10
_REPETITIONS = 200


@dataclass(frozen=True)
class Bin:
    """Answers of about equal confidence."""

    confidence: float
    """Mean probability given to the clip that was predicted to win, in [0.5, 1], of the
    answers as they count."""
    right: float
    """Share of these answers that were foreseen, as they count."""
    answers: int
    alike: int
    """Answers that count the same and say as much (Kish 1965, "Survey Sampling")."""


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """How far predicted probabilities are from what happened."""

    ece: float
    """Expected calibration error: mean over the answers, as they count, of
    |confidence - right| of their bin."""
    ece_by_chance: float
    """What this many answers would show if every probability were exactly right."""
    brier: float
    """Mean squared error of the probabilities; 0.25 says nothing."""
    bins: tuple[Bin, ...]
    """The reliability plot: bins of equally many answers, least confident first."""


def counting(at_random: Tensor, target: Tensor, *, erring: bool) -> Tensor:
    """How much each held-out answer [B] counts, so that together they stand for pairs
    drawn at random.

    Most questions are chosen because the ensemble quarrels about them, and are harder
    than it thinks too: what is asked because of the answer one expects is no sample
    (Farquhar, Gal and Rainforth 2021, "On Statistical Bias in Active Learning"). Where
    answers err, a few drawn at random say too little alone.

    Args:
        at_random: [B] bool, questions that no reward chose.
        target: [B] the answers; a tie is no preference.
        erring: Whether answers are taken to err.
    """
    if erring or int((at_random & (target != 0.5)).sum()) < _ENOUGH_AT_RANDOM:
        return torch.ones(len(at_random))
    return torch.where(at_random, 1.0, _CHOSEN)


def fit_temperature(
    logit: Tensor, target: Tensor, counts: Tensor, *, error_share: float = 0.0
) -> float:
    """The number that held-out logits [B] must be divided by to be calibrated.

    The most probable one under `target` [B], of which each answer counts as `counts`
    [B] says and a share is random, and a broad prior around 1; 1 without any
    preference. One number cannot overfit a few dozen answers, and keeps the order.
    """
    kept = target != 0.5
    if not kept.any():
        return 1.0
    low, high = (math.log(limit) for limit in _TEMPERATURES)
    tried = torch.linspace(low, high, 400, dtype=torch.float64)  # [S]
    logits = as_answered(logit[kept].double() / tried.exp()[:, None], error_share)
    wanted = target[kept].double().expand_as(logits)
    loss = binary_cross_entropy_with_logits(logits, wanted, reduction="none")
    cost = loss @ counts[kept].double() + 0.5 * (tried / _PRIOR_STD).square()
    return float(tried[cost.argmin()].exp())


def cooled_apart(
    logit: Tensor,
    target: Tensor,
    counts: Tensor,
    group: Tensor,
    *,
    error_share: float,
) -> Tensor:
    """Held-out logits [B] of answers, each at the temperature of the answers of all
    groups but its own, of `group` [B]: what fits a number is no measure of it."""
    cooled = logit.clone()
    for own in group.unique():
        others = group != own
        cooled[~others] /= fit_temperature(
            logit[others], target[others], counts[others], error_share=error_share
        )
    return as_answered(cooled, error_share)


def calibration(
    logit: Tensor, target: Tensor, counts: Tensor | None = None
) -> Calibration | None:
    """How well logits [B] that left is better foretell `target` [B]; None without any
    preference.

    Args:
        logit: Of the left clips.
        target: The answers.
        counts: [B] how much each counts; by default all alike.
    """
    kept = target != 0.5
    if not kept.any():
        return None
    counts = torch.ones(len(target)) if counts is None else counts
    probability, weight = logit[kept].double().sigmoid(), counts[kept].double()
    left = target[kept] > 0.5
    confidence = torch.maximum(probability, 1 - probability)
    right = torch.where(probability == 0.5, 0.5, ((probability > 0.5) == left).double())
    errors = (probability - target[kept].double()).square()
    order = confidence.argsort()
    confidence, right, weight = confidence[order], right[order], weight[order]
    count = max(1, min(_MAX_BINS, len(order) // _ANSWERS_PER_BIN))
    sizes = [len(part) for part in torch.arange(len(order)).tensor_split(count)]
    parts = (column.split(sizes) for column in (confidence, right, weight))
    bins = tuple(
        Bin(_mean(sure, part), _mean(hit, part), len(part), _alike(part))
        for sure, hit, part in zip(*parts, strict=True)
    )
    return Calibration(
        ece=float(_ece(confidence, right, weight, sizes)),
        ece_by_chance=_ece_by_chance(confidence, weight, sizes),
        brier=_mean(errors, counts[kept].double()),
        bins=bins,
    )


def _mean(values: Tensor, weight: Tensor) -> float:
    return float((weight * values).sum() / weight.sum())


def _alike(weight: Tensor) -> int:
    return max(1, round(float(weight.sum() ** 2 / weight.square().sum())))


def _ece(confidence: Tensor, right: Tensor, weight: Tensor, sizes: list[int]) -> Tensor:
    """Expected calibration error of outcomes [..., B] that count as `weight` [B] says,
    in bins of `sizes`."""
    gaps = (weight * (right - confidence)).split(sizes, dim=-1)
    return sum(gap.sum(dim=-1).abs() for gap in gaps) / weight.sum()


def _ece_by_chance(confidence: Tensor, weight: Tensor, sizes: list[int]) -> float:
    """Mean error of outcomes drawn with the probabilities `confidence` [B]."""
    rng = torch.Generator().manual_seed(0)
    drawn = torch.rand(_REPETITIONS, len(confidence), generator=rng)  # [R, B]
    outcomes = (drawn < confidence).double()
    return float(_ece(confidence, outcomes, weight, sizes).mean())
