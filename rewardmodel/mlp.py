"""A small network on the descriptors, for tastes that no weighted sum expresses.

Shapes: M ensemble members, B pairs of a batch, S steps looked at, D descriptors.
"""

from __future__ import annotations

import math
from dataclasses import replace
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
    # Pulling targets off 0 and 1 keeps the network from growing without end.
    target = pairs.target.clamp(cfg.mlp.smoothing, 1 - cfg.mlp.smoothing)
    pairs = replace(pairs, target=target)
    counts = bootstrap_counts(cfg.mlp.num_members, len(pairs), generator=generator)
    optimizer = torch.optim.AdamW(
        scorer.parameters(),
        lr=cfg.mlp.learning_rate,
        weight_decay=cfg.mlp.weight_decay,
    )
    for chosen in _batches(len(pairs), cfg.mlp, generator):
        batch = _glimpses(pairs.subset(chosen), cfg.mlp, generator)
        loss = _loss(scorer, batch, counts[:, chosen], cfg)
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
    scorer: MlpScorer, pairs: TrainingPairs, counts: Tensor, cfg: FitCfg
) -> Tensor:
    """Mean negative log-likelihood of a batch, plus the hold on the reward's level."""
    returns = mean_over(scorer(pairs.steps), pairs.scored)  # [M, 2, B]
    left, right = returns.unbind(dim=1)
    likelihood = pairs.log_likelihood(left - right + pairs.fall_lead, cfg)
    level = returns.mean(dim=(1, 2)).square().sum()
    # Summed over the members: each is fitted as if it were alone.
    misfit = -(counts * likelihood).mean(dim=1).sum()
    return misfit + cfg.mlp.mean_reward_penalty * level


def _glimpses(
    pairs: TrainingPairs, cfg: MlpCfg, generator: torch.Generator
) -> TrainingPairs:
    """Steps spread evenly over a random contiguous piece of every clip.

    Neighbouring steps are nearly equal, so few of them cost little accuracy and most
    of the time. The scored steps of a clip come first: only a fall and padding follow.
    """
    length = pairs.scored.sum(dim=-1, keepdim=True)  # [2, B, 1]
    random = torch.rand(2, *length.shape, generator=generator)
    kept = length * (cfg.min_crop + (1 - cfg.min_crop) * random[0])
    place = (torch.arange(cfg.steps_per_clip) + 0.5) / cfg.steps_per_clip
    index = ((length - kept) * random[1] + kept * place).long()  # [2, B, S]
    return replace(
        pairs,
        steps=pairs.steps.take_along_dim(index[..., None], dim=2),
        scored=pairs.scored.take_along_dim(index, dim=2),
    )
