"""Networks on raw rows, as preference learning is published for control.

Lee et al. 2021 ("B-Pref", arXiv 2111.03026), after Christiano et al. 2017: few members,
each with a start of its own and all answers, three wide hidden layers, rewards between
-1 and 1 that a segment sums up.

Shapes: M ensemble members, D columns, B pairs.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor
from torch.nn.functional import leaky_relu

from rewardmodel.cfg import FitCfg
from rewardmodel.extensions_cfg import RawCfg
from rewardmodel.prepared.described import StandardisedPairs
from rewardmodel.prepared.prepared import Prepared

from .mlp import MlpScorer
from .network import pieces


class RawScorer(MlpScorer):
    """Three hidden layers a member."""

    bend = staticmethod(leaky_relu)

    def __init__(self, num_columns: int, cfg: RawCfg) -> None:
        super().__init__(num_columns, cfg, hidden_layers=3)
        self._summed_steps = cfg.summed_steps

    def forward(self, steps: Tensor, starts: Tensor | None = None) -> Tensor:
        """Raw rewards [M, ...] of standardised columns [..., D]: logits, so that the
        mean over a clip is the sum over the steps of a published segment."""
        return self._summed_steps * super().forward(steps, starts).tanh()


def fit_raw(prepared: Prepared, cfg: FitCfg, generator: torch.Generator) -> RawScorer:
    """Fit all members to all answers, until they foresee as many as they are to."""
    pairs = prepared.standardised
    own = cfg.settings_of(RawCfg)
    scorer = RawScorer(pairs.steps.shape[-1], own)
    if (pairs.target == 0.5).all():
        # No answer speaks for anything, and chance would.
        return scorer.requires_grad_(False)
    scorer.initialise(generator)
    optimizer = torch.optim.Adam(scorer.parameters(), lr=own.learning_rate)
    for _ in range(own.most_epochs):
        order = torch.randperm(len(pairs), generator=generator)
        right = []
        for chosen in order.split(own.batch_size):
            batch = _cropped(pairs.subset(chosen), own.min_crop, generator)
            leads = batch.leads(scorer)
            loss = -batch.log_likelihood(leads, cfg).mean(dim=1).sum()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            right.append(_right(leads.detach(), batch))
        # Of nothing but ties the mean is NaN, which is not above anything.
        if float(torch.cat(right, dim=1).nanmean()) > own.enough_accuracy:
            break
    scorer.requires_grad_(False)
    return scorer


def _cropped(
    pairs: StandardisedPairs, min_crop: float, generator: torch.Generator
) -> StandardisedPairs:
    """A random contiguous piece of every clip."""
    if min_crop >= 1.0:
        return pairs
    first, kept = pieces(pairs, min_crop, generator)
    place = torch.arange(pairs.scored.shape[-1]) + 0.5
    return replace(
        pairs, scored=pairs.scored & (place >= first) & (place < first + kept)
    )


def _right(leads: Tensor, pairs: StandardisedPairs) -> Tensor:
    """[M, B] whether each member foresees an answer; NaN for a tie."""
    right = ((leads > 0) == (pairs.target > 0.5)).float()
    return torch.where(pairs.target == 0.5, torch.nan, right)
