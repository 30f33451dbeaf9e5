"""What a model is fitted to: both clips of every pair, described step by step.

Shapes: M ensemble members, B pairs, T steps, L steps looked back, D descriptors,
K steps that count.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor
from torch.nn import functional

from rewardmodel.answers.answered_pairs import AnsweredPairs
from rewardmodel.answers.clip_batch import PART, mean_over
from rewardmodel.answers.likelihood import Errors, log_likelihood
from rewardmodel.cfg import FitCfg
from rewardmodel.descriptors.normaliser import Normaliser, fill_missing
from rewardmodel.descriptors.table import Sight, describe, names_seen
from rewardmodel.opinions.aspects import UNSAID, indices_of


@dataclass(frozen=True, eq=False)
class ClipPairs:
    """Answered pairs seen through the descriptors; axis "2" is left, right."""

    steps: Tensor
    """[2, B, T, D] descriptors."""
    scored: Tensor
    """[2, B, T] bool: steps that count in the mean of their clip."""
    fall_lead: Tensor
    """[B] logit by which the left clip leads because the right one fell."""
    target: Tensor
    """[B] probability that the left clip is better."""
    errors: Errors
    """How reliable each answer is."""
    lift_offs_before: Tensor | None = None
    """[2, B, L] as of `ClipBatch`."""
    aspect: Tensor | None = None
    """[B] what each answer was said to be about, as an index in `ASPECTS`, or
    `UNSAID`; None: nobody said."""

    def __len__(self) -> int:
        return len(self.target)

    def subset(self, chosen: Tensor | slice) -> Self:
        """The pairs in `chosen` [B] (bool or indices)."""
        before = self.lift_offs_before
        return replace(
            self,
            steps=self.steps[:, chosen],
            scored=self.scored[:, chosen],
            fall_lead=self.fall_lead[chosen],
            target=self.target[chosen],
            errors=self.errors.part(chosen),
            aspect=None if self.aspect is None else self.aspect[chosen],
            lift_offs_before=None if before is None else before[:, chosen],
        )

    def parts(self) -> Iterator[Self]:
        """All pairs, some at a time: what is made of many takes more memory than they
        do."""
        for first in range(0, len(self), PART):
            yield self.subset(slice(first, first + PART))

    @property
    def said(self) -> Tensor:
        """[B] `aspect`, of nobody who said."""
        if self.aspect is None:
            return torch.full((len(self),), UNSAID)
        return self.aspect

    @property
    def scored_steps(self) -> Tensor:
        """[K, D] descriptors of every step that counts, of both sides."""
        return self.steps[self.scored]

    def log_likelihood(self, leads: Tensor, cfg: FitCfg) -> Tensor:
        """Log-likelihood [M, B] of the answers at logits `leads` [M, B]."""
        return log_likelihood(
            leads,
            self.target.to(leads.dtype),
            tie_threshold=cfg.tie_threshold,
            error_share=self.errors,
        )


@dataclass(frozen=True, eq=False)
class DescribedPairs(ClipPairs):
    """Pairs with raw descriptors. Those that either clip of a pair lacks are NaN in
    both: a difference to something unknown says nothing."""

    def joined(self, others: DescribedPairs) -> DescribedPairs:
        """These pairs with `others` behind them, padded to one length."""
        num_steps = max(self.steps.shape[2], others.steps.shape[2])
        ours, theirs = self._padded(num_steps), others._padded(num_steps)
        before = (ours.lift_offs_before, theirs.lift_offs_before)
        return DescribedPairs(
            steps=torch.cat([ours.steps, theirs.steps], dim=1),
            scored=torch.cat([ours.scored, theirs.scored], dim=1),
            fall_lead=torch.cat([ours.fall_lead, theirs.fall_lead]),
            target=torch.cat([ours.target, theirs.target]),
            errors=ours.errors.joined(theirs.errors),
            lift_offs_before=(
                None
                if before[0] is None or before[1] is None
                else torch.cat([before[0], before[1]], dim=1)
            ),
            aspect=(
                None
                if ours.aspect is None and theirs.aspect is None
                else torch.cat([ours.said, theirs.said])
            ),
        )

    def _padded(self, num_steps: int) -> DescribedPairs:
        missing = num_steps - self.steps.shape[2]
        return replace(
            self,
            steps=functional.pad(self.steps, (0, 0, 0, missing)),
            scored=functional.pad(self.scored, (0, missing)),
        )

    def seen_by(self, sight: Sight) -> DescribedPairs:
        """The columns of `sight`, which may see less than these pairs tell."""
        return replace(self, steps=self.steps[..., : len(names_seen(sight))])

    def difference(self, normaliser: Normaliser) -> Tensor:
        """[B, D] as of `StandardisedPairs`, by `normaliser`."""
        return torch.cat(
            [part.standardised(normaliser).difference for part in self.parts()]
        )

    def standardised(self, normaliser: Normaliser) -> StandardisedPairs:
        """The pairs by `normaliser`, missing descriptors at their mean."""
        return StandardisedPairs(
            steps=fill_missing(normaliser(self.steps)),
            scored=self.scored,
            fall_lead=self.fall_lead,
            target=self.target,
            errors=self.errors,
            lift_offs_before=self.lift_offs_before,
            aspect=self.aspect,
        )


@dataclass(frozen=True, eq=False)
class StandardisedPairs(ClipPairs):
    """Pairs with descriptors of mean 0 and deviation 1 over all judged steps."""

    @property
    def difference(self) -> Tensor:
        """[B, D] mean descriptors of the left clip minus those of the right."""
        left, right = mean_over(self.steps.mT, self.scored[..., None, :])
        return left - right

    def leads(self, score: Callable[[Tensor], Tensor]) -> Tensor:
        """Logit [M, B] of the left clips, `score` giving raw rewards [M, 2, B, T]."""
        left, right = mean_over(score(self.steps), self.scored).unbind(dim=1)
        return left - right + self.fall_lead


def describe_pairs(pairs: AnsweredPairs, cfg: FitCfg, sight: Sight) -> DescribedPairs:
    """Describe answered pairs, whose raters err as `cfg` says."""
    shape = (2, len(pairs), pairs.left.valid.shape[1])
    steps = torch.empty(*shape, len(names_seen(sight)))
    scored = torch.empty(shape, dtype=torch.bool)
    fell = torch.empty(shape[:2])
    for side, clips in enumerate((pairs.left, pairs.right)):
        for rows, part in clips.parts():
            steps[side, rows] = describe(part.features, sight)
            scored[side, rows] = part.scored
            fell[side, rows] = part.fell.float()
    for first in range(0, len(pairs), PART):
        part = steps[:, first : first + PART]
        if part.isnan().any():
            missing = part.isnan().any(dim=2).any(dim=0)
            part.masked_fill_(missing[:, None], torch.nan)
    before = (pairs.left.lift_offs_before, pairs.right.lift_offs_before)
    return DescribedPairs(
        steps=steps,
        scored=scored,
        fall_lead=cfg.fall_logit * (fell[1] - fell[0]),
        target=pairs.target,
        errors=Errors.alike(
            cfg.error_share, len(pairs), tie_threshold=cfg.tie_threshold
        ),
        lift_offs_before=(
            None
            if before[0] is None or before[1] is None
            else torch.stack([before[0], before[1]])
        ),
        aspect=indices_of(pairs.whys) if pairs.whys else None,
    )


def bootstrap_counts(
    num_members: int, num_pairs: int, *, generator: torch.Generator
) -> Tensor:
    """How often each member sees each answer [M, B]: B draws with replacement."""
    drawn = torch.randint(num_pairs, (num_members, num_pairs), generator=generator)
    counts = torch.zeros(num_members, num_pairs)
    return counts.scatter_add_(1, drawn, torch.ones_like(counts))
