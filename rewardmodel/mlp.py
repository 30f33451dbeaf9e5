"""A small network on the descriptors, for tastes that no weighted sum expresses.

Shapes: M ensemble members, B pairs of a batch, T steps, D descriptors, H hidden units.
"""

from __future__ import annotations

import math
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn.functional import elu

from .cfg import FitCfg, MlpCfg
from .clips import mean_over
from .training import TrainingPairs, bootstrap_counts


class MlpScorer(nn.Module):
    """Two hidden layers a member, all members evaluated by one batched product."""

    def __init__(self, num_members: int, num_descriptors: int, hidden: int) -> None:
        super().__init__()
        sizes = (num_descriptors, hidden, hidden, 1)
        self.weights = nn.ParameterList(
            torch.zeros(num_members, fan_in, fan_out)
            for fan_in, fan_out in pairwise(sizes)
        )
        self.biases = nn.ParameterList(
            torch.zeros(num_members, 1, fan_out) for fan_out in sizes[1:]
        )

    def initialise(self, generator: torch.Generator) -> None:
        """Draw every weight and bias uniformly within 1 / sqrt(fan in)."""
        for weight, bias in zip(self.weights, self.biases, strict=True):
            bound = 1 / math.sqrt(weight.shape[1])
            nn.init.uniform_(weight, -bound, bound, generator=generator)
            nn.init.uniform_(bias, -bound, bound, generator=generator)

    def forward(self, steps: Tensor) -> Tensor:
        """Raw rewards [M, ...] of standardised descriptors [..., D]."""
        hidden = steps.flatten(0, -2).expand(len(self.weights[0]), -1, -1)
        last = len(self.weights) - 1
        for layer, (weight, bias) in enumerate(
            zip(self.weights, self.biases, strict=True)
        ):
            hidden = torch.baddbmm(bias, hidden, weight)
            if layer < last:
                hidden = elu(hidden)
        return hidden.reshape(-1, *steps.shape[:-1])


def fit_mlp(
    pairs: TrainingPairs, cfg: FitCfg, *, generator: torch.Generator
) -> MlpScorer:
    """Fit each member to its own bootstrap of standardised `pairs`, by AdamW."""
    scorer = MlpScorer(cfg.mlp.num_members, pairs.steps.shape[-1], cfg.mlp.hidden_size)
    scorer.initialise(generator)
    counts = bootstrap_counts(cfg.mlp.num_members, len(pairs), generator=generator)
    optimizer = torch.optim.AdamW(
        scorer.parameters(),
        lr=cfg.mlp.learning_rate,
        weight_decay=cfg.mlp.weight_decay,
    )
    for chosen in _batches(len(pairs), cfg.mlp, generator):
        loss = _loss(scorer, pairs.subset(chosen), counts[:, chosen], cfg, generator)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    return scorer.requires_grad_(False)


def _batches(num_pairs: int, cfg: MlpCfg, generator: torch.Generator) -> list[Tensor]:
    """Indices of the pairs of every gradient step; all are seen before one returns."""
    passes = math.ceil(cfg.num_updates / math.ceil(num_pairs / cfg.batch_size))
    batches = [
        chosen
        for _ in range(passes)
        for chosen in torch.randperm(num_pairs, generator=generator).split(
            cfg.batch_size
        )
    ]
    return batches[: cfg.num_updates]


def _loss(
    scorer: MlpScorer,
    pairs: TrainingPairs,
    counts: Tensor,
    cfg: FitCfg,
    generator: torch.Generator,
) -> Tensor:
    """Mean negative log-likelihood of a batch, plus the hold on the reward's level."""
    scored = _cropped(pairs.scored, cfg.mlp.min_crop, generator)
    returns = mean_over(scorer(pairs.steps), scored)  # [M, 2, B]
    left, right = returns.unbind(dim=1)
    likelihood = pairs.log_likelihood(left - right + pairs.fall_lead, cfg)
    level = returns.mean(dim=(1, 2)).square().sum()
    # Summed over the members: each is fitted as if it were alone.
    misfit = -(counts * likelihood).mean(dim=1).sum()
    return misfit + cfg.mlp.mean_reward_penalty * level


def _cropped(scored: Tensor, min_crop: float, generator: torch.Generator) -> Tensor:
    """Keep a random contiguous piece of the scored steps [2, B, T] of every clip."""
    length = scored.sum(dim=-1, keepdim=True)
    shape = length.shape
    share = min_crop + (1 - min_crop) * torch.rand(shape, generator=generator)
    kept = (share * length).ceil()
    first = (torch.rand(shape, generator=generator) * (length - kept + 1)).floor()
    # Scored steps come first in a clip: only padding and the fall follow them.
    step = torch.arange(scored.shape[-1])
    return scored & (step >= first) & (step < first + kept)
