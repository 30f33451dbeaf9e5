"""What the small networks have in common: how they are fitted to pairs.

Shapes: M ensemble members, B pairs of a batch, T steps, S steps looked at,
D descriptors.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor, nn

from rewardmodel.answers.clip_batch import mean_over
from rewardmodel.cfg import FitCfg
from rewardmodel.extensions_cfg import NetworkCfg
from rewardmodel.prepared.described import StandardisedPairs, bootstrap_counts
from rewardmodel.scorer import Scorer

Look = Callable[[StandardisedPairs, torch.Generator], StandardisedPairs]
"""What a gradient step sees of a batch of pairs."""


class Network(Scorer):
    """Members that are drawn at random and then fitted by descent."""

    def initialise(self, generator: torch.Generator) -> None:
        """Draw every weight and bias."""
        raise NotImplementedError


def draw_uniformly(
    tensor: Tensor, fan_in: int, generator: torch.Generator, *, gain: float = 1.0
) -> None:
    """Fill with draws within sqrt(gain / fan in); a gain of 3 keeps the variance."""
    bound = math.sqrt(gain / fan_in)
    nn.init.uniform_(tensor, -bound, bound, generator=generator)


def fit_network(
    network: Network,
    pairs: StandardisedPairs,
    cfg: FitCfg,
    own: NetworkCfg,
    *,
    look: Look,
    generator: torch.Generator,
) -> None:
    """Draw and fit each member of `network` to its own bootstrap of `pairs`, by AdamW.

    Args:
        network: Turns what `look` gives of the steps into raw rewards [M, 2, B, S].
        pairs: Standardised.
        cfg: The likelihood of an answer.
        own: Sizes of the fit.
        look: Draws a random view of every batch.
        generator: Every random draw.
    """
    network.initialise(generator)
    # Pulling targets off 0 and 1 keeps the network from growing without end.
    target = pairs.target.clamp(own.smoothing, 1 - own.smoothing)
    pairs = replace(pairs, target=target)
    counts = bootstrap_counts(own.num_members, len(pairs), generator=generator)
    optimizer = torch.optim.AdamW(
        network.parameters(), lr=own.learning_rate, weight_decay=own.weight_decay
    )
    for chosen in _batches(len(pairs), own, generator):
        batch = look(pairs.subset(chosen), generator)
        loss = _loss(network, batch, counts[:, chosen], cfg, own)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    network.requires_grad_(False)


def glimpses(
    pairs: StandardisedPairs, steps: int, min_crop: float, generator: torch.Generator
) -> StandardisedPairs:
    """`steps` steps spread evenly over a random contiguous piece of every clip.

    Neighbouring steps are nearly equal, so few of them cost little accuracy and most
    of the time.
    """
    first, kept = pieces(pairs, min_crop, generator)
    place = (torch.arange(steps) + 0.5) / steps
    index = (first + kept * place).long()  # [2, B, S]
    return replace(
        pairs,
        steps=pairs.steps.take_along_dim(index[..., None], dim=2),
        scored=pairs.scored.take_along_dim(index, dim=2),
    )


def pieces(
    pairs: StandardisedPairs, min_crop: float, generator: torch.Generator
) -> tuple[Tensor, Tensor]:
    """First step and length [2, B, 1] of a random contiguous piece of every clip.

    The scored steps of a clip come first: only a fall and padding follow.
    """
    length = pairs.scored.sum(dim=-1, keepdim=True)
    random = torch.rand(2, *length.shape, generator=generator)
    kept = length * (min_crop + (1 - min_crop) * random[0])
    return (length - kept) * random[1], kept


def _batches(num_pairs: int, own: NetworkCfg, rng: torch.Generator) -> list[Tensor]:
    """Indices of the pairs of every gradient step; all are seen before one returns."""
    passes = math.ceil(own.num_updates / math.ceil(num_pairs / own.batch_size))
    batches = [
        chosen
        for _ in range(passes)
        for chosen in torch.randperm(num_pairs, generator=rng).split(own.batch_size)
    ]
    return batches[: own.num_updates]


def _loss(
    network: Network,
    pairs: StandardisedPairs,
    counts: Tensor,
    cfg: FitCfg,
    own: NetworkCfg,
) -> Tensor:
    """Mean negative log-likelihood of a batch, plus the hold on the reward's level."""
    returns = mean_over(network(pairs.steps), pairs.scored)  # [M, 2, B]
    left, right = returns.unbind(dim=1)
    likelihood = pairs.log_likelihood(left - right + pairs.fall_lead, cfg)
    level = returns.mean(dim=(1, 2)).square().sum()
    # Summed over the members: each is fitted as if it were alone.
    misfit = -(counts * likelihood).mean(dim=1).sum()
    return misfit + own.mean_reward_penalty * level
