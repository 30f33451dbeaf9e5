"""A Gaussian process over gait descriptors, for tastes no weighted sum expresses.

The reward of a step is drawn from a process with a linear and a squared exponential
kernel, and a clip's return is the mean over its steps, so that clips are compared, and
steps are paid, by the same function. The squared exponential kernel is replaced by
random Fourier features (Rahimi and Recht 2007): the process is then linear in them, and
its posterior mode is found as that of the linear model.

Shapes: M ensemble members, B pairs, D descriptors, R random features.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from rewardmodel.answers.clip_batch import mean_over
from rewardmodel.cfg import FitCfg
from rewardmodel.extensions_cfg import GpCfg
from rewardmodel.linear.laplace import posterior_modes
from rewardmodel.prepared.described import bootstrap_counts
from rewardmodel.prepared.prepared import MIN_SPREAD, Prepared
from rewardmodel.scorer import Scorer


class GpScorer(Scorer):
    """Weights of all members over descriptors and their random features."""

    def __init__(self, num_descriptors: int, cfg: GpCfg) -> None:
        super().__init__()
        num_members, num_features = cfg.num_members, cfg.num_features
        self.frequencies: Tensor
        self.phases: Tensor
        self.weights: Tensor
        total = num_descriptors + num_features
        self.register_buffer("frequencies", torch.zeros(num_descriptors, num_features))
        self.register_buffer("phases", torch.zeros(num_features))
        self.register_buffer("weights", torch.zeros(num_members, total))

    def draw(self, length_scale: float, generator: torch.Generator) -> None:
        """Draw the random features of a kernel with this length scale."""
        shape = self.frequencies.shape
        drawn = torch.randn(shape, generator=generator) / length_scale
        self.frequencies.copy_(drawn)
        turns = torch.rand(self.phases.shape, generator=generator)
        self.phases.copy_(2 * math.pi * turns)

    def features(self, steps: Tensor) -> Tensor:
        """Standardised descriptors [..., D], followed by random features [..., R]."""
        waves = (steps @ self.frequencies + self.phases).cos()
        return torch.cat([steps, waves * (2 / len(self.phases)) ** 0.5], dim=-1)

    def forward(self, steps: Tensor, starts: Tensor | None = None) -> Tensor:
        """Raw rewards [M, ...] of standardised descriptors [..., D]."""
        return (self.features(steps) @ self.weights.mT).movedim(-1, 0)


def fit_gp(prepared: Prepared, cfg: FitCfg, generator: torch.Generator) -> GpScorer:
    """Fit each member to its own bootstrap of the answers.

    Its linear part is expected to be as strong as a linear model's, of nothing in
    particular; the rest is scaled so that it is expected to shift the logit of a pair
    by `GpCfg.amplitude`.
    """
    own, pairs = cfg.settings_of(GpCfg), prepared.standardised
    num_descriptors = pairs.steps.shape[-1]
    scorer = GpScorer(num_descriptors, own)
    # Standardised steps are about sqrt(2 D) apart.
    usual_distance = math.sqrt(2 * num_descriptors)
    scorer.draw(own.length_scale * usual_distance, generator)

    values = scorer.features(pairs.steps)
    left, right = mean_over(values.mT, pairs.scored[..., None, :])
    difference = (left - right).double()
    spread = difference.square().mean(dim=0).sqrt()
    waved = spread[num_descriptors:].square().sum().sqrt()
    units = torch.cat(
        [
            spread[:num_descriptors].clamp_min(MIN_SPREAD),
            (waved / own.amplitude).clamp_min(1e-6).expand(own.num_features),
        ]
    )
    counts = bootstrap_counts(own.num_members, len(pairs), generator=generator)
    theta = posterior_modes(
        difference / units,
        pairs,
        counts.double(),
        cfg,
        precision=cfg.linear.prior_precision,
    )
    scorer.weights.copy_(theta / units)
    return scorer
