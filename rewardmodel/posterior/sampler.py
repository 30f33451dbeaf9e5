"""What answers make of a prior over wishes: particles, resampled and moved.

Sequential Monte Carlo for a static parameter (Chopin 2002): answers reweight the
particles one by one; where few carry the weight they are resampled and each makes some
Metropolis-Hastings moves that leave the posterior as it is.

Shapes: N particles, J opinions of each, A opinions there are, B answers, R raters.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from data.answers.answer_records import ASPECTS
from rewardmodel.answers.likelihood import Errors, answer_weights, weighted
from rewardmodel.opinions.aspects import UNSAID
from rewardmodel.opinions.opinions import (
    ASPECT_OF_OPINION,
    SHAPE_PROBABLE,
    SHAPES,
    Opinions,
    habit_of,
)

from .hypotheses import (
    ANOTHER,
    SLOTS,
    Hypotheses,
    Prior,
    drawn,
    drawn_of,
    drawn_sharpness,
    drawn_weights,
)

_MOVES = 12
"""Moves of every particle after a resampling."""
_LEAST_EFFECTIVE = 0.6
"""Share of the particles below which the effective number leads to a resampling."""
_MEANT = 0.75
"""Share of reasons that are meant; the rest is any aspect."""
_TINY = 1e-12
"""Probability of an answer that is not on offer, and never given."""
_ALONE_SHARPNESS, _ALONE_ERRORS = 5.0, 0.15
"""By which opinions are judged alone, to propose those that explain the answers."""


@dataclass(frozen=True, eq=False)
class Answers:
    """Answers as opinions see them."""

    difference: Tensor
    """[A, B] how much more every opinion thinks of the left clip."""
    fall_lead: Tensor
    """[B] logit for the left clip because the right one fell."""
    target: Tensor
    """[B] probability that the left clip is better."""
    errors: Errors
    """Who gave each, and how often random ones are left, right, tie."""
    aspect: Tensor
    """[B] what each was said to be about, an index in `ASPECTS` or `UNSAID`."""
    tie_threshold: float
    """Logits of lead below which a difference is not seen."""

    def __len__(self) -> int:
        return len(self.target)

    def part(self, rows: Tensor) -> Answers:
        """Some of them."""
        return replace(
            self,
            difference=self.difference[:, rows],
            fall_lead=self.fall_lead[rows],
            target=self.target[rows],
            errors=self.errors.part(rows),
            aspect=self.aspect[rows],
        )

    @property
    def num_raters(self) -> int:
        return int(self.errors.rater.max()) + 1

    @property
    def by_chance(self) -> float:
        """Logarithm of how probable the answers are if all are random, and what they
        are said to be about is any aspect."""
        weights = answer_weights(self.target, tie_threshold=self.tie_threshold)
        offered = weights > 0
        said = int(self._said.sum()) * math.log(1 / len(ASPECTS))
        return float((weights * self.errors.guess.log())[offered].sum()) + said

    def log_likelihood(self, leads: Tensor, error_share: Tensor) -> Tensor:
        """[N] of all answers, from what opinions say of the lead [N, B] and shares of
        random answers [N, R]."""
        leads, error = leads + self.fall_lead, error_share[:, self.errors.rater]
        left = (leads - self.tie_threshold).sigmoid()
        right = (-leads - self.tie_threshold).sigmoid()
        meant = (left, right, 1 - left - right)
        # Errors keep every probability far from 0.
        log_p = torch.stack(
            [
                ((1 - error) * p + error * guess + _TINY).log()
                for p, guess in zip(meant, self.errors.guess, strict=True)
            ]
        )
        return weighted(log_p, self.target, self.tie_threshold).sum(dim=1)

    def log_about(self, found: Hypotheses, opinions: Opinions) -> Tensor | float:
        """[N] logarithm of how probable what they say to be about is; 0 of nothing."""
        if not (said := self._said).any():
            return 0.0
        about = found.about(opinions, self.difference[:, said])
        index = self.aspect[said].expand(len(found), 1, -1)
        return _log_said(about.gather(1, index)[:, 0])

    def log_about_alone(self) -> Tensor | float:
        """[A] the same of every opinion alone."""
        if not (said := self._said).any():
            return 0.0
        own = ASPECT_OF_OPINION[:, self.aspect[said]]
        return _log_said(own.to(self.difference.dtype))

    @property
    def _said(self) -> Tensor:
        return self.aspect != UNSAID


def _log_said(meant: Tensor) -> Tensor:
    """[N] of shares [N, B] that what was said has of what is meant."""
    return (_MEANT * meant + (1 - _MEANT) / len(ASPECTS)).log().sum(dim=1)


@dataclass(frozen=True, eq=False)
class Posterior:
    """What is found."""

    found: Hypotheses
    """Each as probable as any other."""
    log_evidence: float
    """Logarithm of how probable the answers were, by estimate."""


def sampled(
    opinions: Opinions,
    careless: float,
    answers: Answers,
    count: int,
    generator: torch.Generator,
) -> Posterior:
    """`count` hypotheses after `answers`, which are learned from in their order.

    Args:
        opinions: What can be thought of the clips.
        careless: How probable it is that a rater errs as often as no other.
        answers: At least one.
        count: Of the particles.
        generator: Every draw.
    """
    prior = Prior(num_raters=answers.num_raters, careless=careless)
    found = drawn(opinions, prior, count, generator)
    log_weight = torch.zeros(count)
    evidence = 0.0
    for number in range(len(answers)):
        new = answers.part(torch.tensor([number]))
        leads = found.leads(opinions, new.difference)
        before = log_weight.logsumexp(dim=0)
        log_weight += new.log_likelihood(leads, found.error_share)
        log_weight += new.log_about(found, opinions)
        evidence += float(log_weight.logsumexp(dim=0) - before)
        last = number == len(answers) - 1
        if last or effective(log_weight) < _LEAST_EFFECTIVE * count:
            found = found[resampled(log_weight, generator)]
            log_weight = torch.zeros(count)
            so_far = answers.part(torch.arange(number + 1))
            found = after_moves(found, opinions, prior, so_far, generator)
    return Posterior(found, evidence)


def effective(log_weight: Tensor) -> float:
    """Effective number of particles (Kong, Liu and Wong 1994)."""
    weight = log_weight.softmax(dim=0)
    return float(1 / weight.square().sum())


def resampled(log_weight: Tensor, generator: torch.Generator) -> Tensor:
    """[N] indices drawn as probable as the weights, systematically (Kitagawa 1996)."""
    count = len(log_weight)
    ends = log_weight.double().softmax(dim=0).cumsum(dim=0)
    at = torch.arange(count) + torch.rand(1, generator=generator, dtype=torch.float64)
    return torch.searchsorted(ends, at / count).clamp(max=count - 1)


def after_moves(
    found: Hypotheses,
    opinions: Opinions,
    prior: Prior,
    answers: Answers,
    generator: torch.Generator,
) -> Hypotheses:
    """`found` after moves of each, by which the posterior stays as it is."""
    proposal = _proposal(opinions, answers)
    # None can be drawn that is impossible, save by another shape.
    odds = (opinions.probable / proposal.clamp_min(1e-30)).log()

    def log_likelihood(of: Hypotheses) -> Tensor:
        leads = of.leads(opinions, answers.difference)
        said = answers.log_about(of, opinions)
        return answers.log_likelihood(leads, of.error_share) + said

    believed = log_likelihood(found)
    for _ in range(_MOVES):
        moved, corrected = _proposed(found, prior, proposal, odds, generator)
        likely = log_likelihood(moved)
        chance = torch.rand(len(found), generator=generator).log()
        taken = (chance < likely - believed + corrected) & ~moved.doubled
        found = moved.where(taken, found)
        believed = torch.where(taken, likely, believed)
    return found


def _proposed(
    found: Hypotheses,
    prior: Prior,
    proposal: Tensor,
    odds: Tensor,
    generator: torch.Generator,
) -> tuple[Hypotheses, Tensor]:
    """A move of every particle, and the logarithm [N] of what prior and proposal make
    of its odds: an opinion anew, another shape of it, its weight, or how reliable the
    answers are."""
    count = len(found)
    kind = torch.rand(count, generator=generator)
    anew, reshaped = kind < 0.5, (kind >= 0.5) & (kind < 0.7)
    weighed, reliability = (kind >= 0.7) & (kind < 0.85), kind >= 0.85
    slot = torch.randint(SLOTS, (count, 1), generator=generator)

    old = found.opinion.gather(1, slot)[:, 0]
    new = drawn_of(proposal, (count,), generator)
    shape = drawn_of(SHAPE_PROBABLE, (count,), generator)
    other = habit_of(old) * len(SHAPES) + shape
    opinion = torch.where(anew, new, torch.where(reshaped, other, old))

    before = found.weight.gather(1, slot)[:, 0]
    weight = drawn_weights((count,), generator)
    on = (torch.rand(count, generator=generator) < ANOTHER) | (slot[:, 0] == 0)
    again = torch.where(weighed & (before > 0), weight, before)
    weight = torch.where(anew, weight * on, again)

    shares = prior.drawn_shares(count, generator)
    by_prior = torch.zeros(count)
    if prior.num_raters > 1:
        one = prior.with_another(found.error_share, generator)
        alone = torch.rand(count, generator=generator) < 0.8
        shares = torch.where(alone[:, None], one, shares)
        gained = prior.log_probable(one) - prior.log_probable(found.error_share)
        by_prior = gained.masked_fill(~(reliability & alone), 0.0)
    sharp = drawn_sharpness(count, generator)
    moved = Hypotheses(
        opinion=found.opinion.scatter(1, slot, opinion[:, None]),
        weight=found.weight.scatter(1, slot, weight[:, None]),
        sharpness=torch.where(reliability, sharp, found.sharpness),
        error_share=torch.where(reliability[:, None], shares, found.error_share),
    )
    corrected = torch.where(anew, odds[new] - odds[old], by_prior)
    impossible = reshaped & odds[other].isinf()
    return moved, corrected.masked_fill(impossible, -torch.inf)


def _proposal(opinions: Opinions, answers: Answers) -> Tensor:
    """[A] half the prior, half the prior times the root of how well each opinion alone
    explains the answers."""
    leads = _ALONE_SHARPNESS * answers.difference
    share = torch.full((len(leads), answers.num_raters), _ALONE_ERRORS)
    alone = answers.log_likelihood(leads, share) + answers.log_about_alone()
    informed = (opinions.probable.log() + 0.5 * alone).softmax(dim=0)
    return 0.5 * informed + 0.5 * opinions.probable
