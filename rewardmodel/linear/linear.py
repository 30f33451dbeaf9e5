"""The default model: a reward linear in the standardised descriptors.

With human error rates a flexible model is lost in the first thirty answers, and this
one is not: 25 weights, a Gaussian prior, a likelihood that expects wrong answers.

Shapes: M ensemble members, B pairs, D descriptors, S step sizes.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from rewardmodel.cfg import FitCfg, LinearCfg
from rewardmodel.descriptors.habits import EFFORT, FEET, TOLD, UNSTEADY, named
from rewardmodel.descriptors.table import DESCRIPTOR_NAMES
from rewardmodel.prepared.described import ClipPairs, bootstrap_counts
from rewardmodel.prepared.prepared import MIN_SPREAD, Prepared
from rewardmodel.scorer import Additive, Scorer

from .laplace import posterior_modes

_USUAL_SPREAD = 0.25
_STRENGTHS = ((TOLD, 2.0), (EFFORT, 1 / 2), (FEET, 1 / 3))
"""How strong opinions about some habits are expected to be beside others."""
ALIKE = 0.8
"""Correlation, before any answer, of opinions about the ways not to do what is told."""
_FEWEST_MEMBERS = 5
_MOST_DRAWN = 20_000
"""Answers that all members together are fitted to: with more of them, resampling moves
a member less, and the mean of fewer is as good."""


class LinearScorer(Scorer):
    """Weights of all members over the standardised descriptors."""

    def __init__(self, num_members: int, num_descriptors: int) -> None:
        super().__init__()
        self.weights: Tensor
        self.expected: Tensor
        """[D] what was expected of them before any answer"""
        self.register_buffer("weights", torch.zeros(num_members, num_descriptors))
        self.register_buffer("expected", torch.zeros(num_descriptors))

    @property
    def linear_weights(self) -> Tensor:
        """[M, D] the weights."""
        return self.weights

    def forward(self, steps: Tensor, starts: Tensor | None = None) -> Tensor:
        """Raw rewards [M, ...] of standardised descriptors [..., D]."""
        return (steps @ self.weights.mT).movedim(-1, 0)

    def additive(self, places: Tensor, low: Tensor, high: Tensor) -> Additive:
        """Straight lines."""
        values = low + places * (high - low)
        return Additive(values, values * self.weights[:, None])


def members_for(cfg: LinearCfg, num_pairs: int) -> LinearCfg:
    """`cfg` with no more members than `num_pairs` answers need.

    With a hundred answers the mean of five members follows chance in the resampling; of
    fifty it does not.
    """
    enough = max(_FEWEST_MEMBERS, _MOST_DRAWN // num_pairs)
    return replace(cfg, num_members=min(cfg.num_members, enough))


def fit_linear(
    prepared: Prepared, cfg: FitCfg, generator: torch.Generator
) -> LinearScorer:
    """Fit each member to its own bootstrap of the answers."""
    pairs, scaled = prepared.described, prepared.clips.differences
    inputs, spread = scaled.inputs, scaled.spread
    mean = expected_weights(pairs, spread, cfg.linear)
    factor = prepared.opinions
    if factor is None:
        factor = prior_factor(cfg.linear, len(spread))
    counts = bootstrap_counts(cfg.linear.num_members, len(pairs), generator=generator)
    whitened = posterior_modes(
        inputs @ factor,
        pairs,
        counts.double(),
        cfg,
        precision=cfg.linear.prior_precision,
        mean=whitened_weights(mean, factor),
    )
    theta = whitened @ factor.mT
    scorer = LinearScorer(*theta.shape)
    scorer.weights.copy_(theta / spread)
    scorer.expected.copy_(mean / spread)
    return scorer


def expected_weights(pairs: ClipPairs, spread: Tensor, cfg: LinearCfg) -> Tensor:
    """Mean [D] of the prior on the weights of differences scaled by `spread` [D].

    It fades where clips hardly differed in a habit: what is expected of a step does not
    grow without bound by its being rare. Where no clip was preferred to another,
    nothing is expected either.
    """
    if not cfg.unsteady_logit or (pairs.target == 0.5).all():
        return torch.zeros_like(spread)
    seen = (spread / _USUAL_SPREAD).clamp_max(1) * (spread > MIN_SPREAD)
    return -cfg.unsteady_logit * named(UNSTEADY) * seen


def prior_factor(cfg: LinearCfg, count: int) -> Tensor:
    """Lower triangular L [D, D], in float64: L L' is the prior covariance of the
    weights of D scaled differences, `count`, in units of 1 / `prior_precision`.

    A robot is told something for a purpose, all of it for the same one; how it moves
    its feet and joints follows from that, and what tumbles moves them too. So much is
    believed of the former, and less of the latter. Which way an opinion goes, answers
    alone decide.
    """
    if not cfg.told_most:
        return torch.eye(count, dtype=torch.float64)
    strength = torch.ones(len(DESCRIPTOR_NAMES), dtype=torch.float64)
    for names, times in _STRENGTHS:
        strength[named(names)] = times
    return of_one_piece(strength, named(TOLD))


def of_one_piece(strength: Tensor, told: Tensor) -> Tensor:
    """L [D, D] of opinions as strong as `strength` [D], of which those in `told` [D]
    (bool) go together."""
    alike = ALIKE * torch.outer(told.double(), told.double())
    own = torch.diag(1 - alike.diagonal())
    return strength.double()[:, None] * torch.linalg.cholesky(alike + own)


def whitened_weights(weights: Tensor, factor: Tensor) -> Tensor:
    """What weights [D] are of differences multiplied by `factor` [D, D]."""
    return torch.linalg.solve_triangular(factor, weights[:, None], upper=False)[:, 0]
