"""Networks on raw rows, as preference learning is published for control.

Lee et al. 2021 ("B-Pref", arXiv 2111.03026), after Christiano et al. 2017: few members,
each with a start of its own and all answers, three wide hidden layers, rewards between
-1 and 1 that a segment sums up.

Shapes: M ensemble members, D columns, B pairs.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn.functional import leaky_relu

from rewardmodel.cfg import FitCfg
from rewardmodel.extensions_cfg import RawCfg
from rewardmodel.prepared.described import StandardisedPairs
from rewardmodel.prepared.prepared import Prepared
from rewardmodel.scorer import Scorer

from .network import draw_uniformly, pieces


class RawScorer(Scorer):
    """Three hidden layers a member, all members evaluated by one batched product."""

    def __init__(self, num_columns: int, cfg: RawCfg) -> None:
        super().__init__()
        sizes = (num_columns, *[cfg.hidden_size] * 3, 1)
        self._summed_steps = cfg.summed_steps
        self.weights = nn.ParameterList(
            torch.zeros(cfg.num_members, fan_in, fan_out)
            for fan_in, fan_out in pairwise(sizes)
        )
        self.biases = nn.ParameterList(
            torch.zeros(cfg.num_members, 1, fan_out) for fan_out in sizes[1:]
        )

    def initialise(self, generator: torch.Generator) -> None:
        """Draw every weight and bias, as `torch.nn.Linear` does."""
        for weight, bias in zip(self.weights, self.biases, strict=True):
            draw_uniformly(weight, weight.shape[1], generator)
            draw_uniformly(bias, weight.shape[1], generator)

    def forward(self, steps: Tensor, starts: Tensor | None = None) -> Tensor:
        """Raw rewards [M, ...] of standardised columns [..., D]: logits, so that the
        mean over a clip is the sum over the steps of a published segment."""
        hidden = steps.flatten(0, -2).expand(len(self.weights[0]), -1, -1)
        last = len(self.weights) - 1
        for layer, (weight, bias) in enumerate(
            zip(self.weights, self.biases, strict=True)
        ):
            hidden = torch.baddbmm(bias, hidden, weight)
            if layer < last:
                hidden = leaky_relu(hidden)
        rewards = hidden.tanh().reshape(-1, *steps.shape[:-1])
        return self._summed_steps * rewards


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
