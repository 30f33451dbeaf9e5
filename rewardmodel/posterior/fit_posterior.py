"""The posterior of prepared answers.

Shapes: A opinions, B answers, R raters.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from rewardmodel.answers.likelihood import answer_weights
from rewardmodel.cfg import FitCfg
from rewardmodel.opinions.pool import Pool
from rewardmodel.prepared.described import StandardisedPairs
from rewardmodel.prepared.prepared import Prepared

from .curve_scorer import PosteriorScorer
from .sampler import Answers, Posterior, sampled

_USUAL = 10.0
"""Answers, as many of each kind, that random ones are expected to be like besides."""


def fit_posterior(
    prepared: Prepared, cfg: FitCfg, generator: torch.Generator
) -> PosteriorScorer:
    """Particles after the answers."""
    pool, settings = pool_of(prepared), cfg.posterior
    posterior = posterior_of(prepared, cfg, generator)
    scorer = PosteriorScorer(settings.num_particles, settings.num_members)
    raters = posterior.found.error_share.shape[1]
    answers_of = prepared.described.errors.rater.bincount(minlength=raters)
    scorer.hold(posterior.found, pool.opinions, pool.ranges, answers_of)
    return scorer


def posterior_of(
    prepared: Prepared, cfg: FitCfg, generator: torch.Generator
) -> Posterior:
    """What the answers make of the prior."""
    pool = pool_of(prepared)
    answers = answers_seen(prepared.by(pool.normaliser), pool, cfg)
    count, careless = cfg.posterior.num_particles, cfg.reliability.careless
    return sampled(pool.opinions, careless, answers, count, generator)


def shares_of_raters(prepared: Prepared, cfg: FitCfg) -> tuple[float, ...]:
    """[R] share of the answers of each rater that is random, in the mean."""
    found = posterior_of(prepared, cfg, torch.Generator().manual_seed(0)).found
    return tuple(found.error_share.mean(dim=0).tolist())


def probably_chance(prepared: Prepared, cfg: FitCfg, *, seed: int) -> float:
    """Probability that the answers are random, as were even odds that they all are.

    A random answer is taken to be left, right or equal as often as these are. Who fell
    tells nothing.
    """
    standing = prepared.described.fall_lead == 0
    if not standing.any():
        return 1.0
    prepared = prepared.subset(standing)
    pairs = prepared.described
    said = answer_weights(pairs.target, tie_threshold=cfg.tie_threshold).sum(dim=1)
    offered = pairs.errors.guess[:, 0] > 0
    usual = (said + _USUAL) * offered
    guess = (usual / usual.sum())[:, None].expand(3, len(pairs))
    prepared = prepared.with_errors(replace(pairs.errors, guess=guess))
    generator = torch.Generator().manual_seed(seed)
    pool = pool_of(prepared)
    answers = answers_seen(prepared.by(pool.normaliser), pool, cfg)
    sense = posterior_of(prepared, cfg, generator).log_evidence
    return float(torch.tensor(answers.by_chance - sense).sigmoid())


def answers_seen(pairs: StandardisedPairs, pool: Pool, cfg: FitCfg) -> Answers:
    """Answers as the opinions of `pool` see them."""

    def worth(side: int) -> Tensor:
        before = pairs.lift_offs_before
        occupied = pool.occupancy_of(
            pairs.steps[side],
            pairs.scored[side],
            None if before is None else before[side],
        )
        return pool.opinions.worth(occupied)

    return Answers(
        difference=worth(0) - worth(1),
        fall_lead=pairs.fall_lead,
        target=pairs.target,
        errors=pairs.errors,
        tie_threshold=cfg.tie_threshold,
        aspect=pairs.said,
    )


def pool_of(prepared: Prepared) -> Pool:
    """What the answers are about.

    Raises:
        ValueError: they were prepared for another kind of model.
    """
    if prepared.clips.pool is None:
        raise ValueError("these answers were prepared for a model without a pool")
    return prepared.clips.pool
