"""The network that Uni-RLHF fits to its labels, as a baseline.

Three members of three layers of 256, leaky ReLU, a hyperbolic tangent at the end,
summed over the steps of a segment; Adam at 3e-4, batches of 64, until they are right
about 96.8 % of what they are fitted to, at most so many epochs (Yuan et al. 2024,
"Uni-RLHF", and the settings of its published code).

Shapes: S segments, T steps, F columns, Q answers, M members.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn.functional import cross_entropy

from data.datasets.segments import Segments, TableAnswer

MEMBERS, LAYERS, WIDTH = 3, 3, 256
LEARNING_RATE, BATCH, EPOCHS = 3e-4, 64, 300
RIGHT_ENOUGH = 0.968


def published_leads(
    segments: Segments,
    fitted: Sequence[TableAnswer],
    asked: Sequence[TableAnswer],
    *,
    seed: int,
    most_epochs: int = EPOCHS,
) -> Tensor:
    """Logits [Q] that the left segment is better, of the answers `asked`.

    Args:
        segments: What both are about, all of one length.
        fitted: What the network learns from.
        asked: What it is asked about.
        seed: First weights and batches.
        most_epochs: When it ends at the latest.
    """
    rows = torch.from_numpy(segments.rows).float()
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        members = [_network(rows.shape[-1]) for _ in range(MEMBERS)]
        _fit(members, rows, fitted, most_epochs)
    with torch.no_grad():
        return torch.stack([_leads(member, rows, asked) for member in members]).mean(0)


def _network(columns: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for _ in range(LAYERS):
        layers += [nn.Linear(columns, WIDTH), nn.LeakyReLU()]
        columns = WIDTH
    return nn.Sequential(*layers, nn.Linear(columns, 1), nn.Tanh())


def _fit(
    members: Sequence[nn.Sequential],
    rows: Tensor,
    answers: Sequence[TableAnswer],
    most_epochs: int,
) -> None:
    weights = [weight for member in members for weight in member.parameters()]
    optimiser = torch.optim.Adam(weights, lr=LEARNING_RATE)
    for _ in range(most_epochs):
        orders = [torch.randperm(len(answers)).split(BATCH) for _ in members]
        right, preferences = 0, 0
        for batches in zip(*orders, strict=True):
            optimiser.zero_grad()
            for member, batch in zip(members, batches, strict=True):
                own = [answers[int(i)] for i in batch]
                lead = _leads(member, rows, own)
                left = torch.tensor([answer.target for answer in own])
                target = torch.stack([left, 1 - left], dim=1)
                logits = torch.stack([lead, torch.zeros_like(lead)], dim=1)
                cross_entropy(logits, target).backward()
                kept = left != 0.5
                right += int(((lead > 0) == (left > 0.5))[kept].sum())
                preferences += int(kept.sum())
            optimiser.step()
        if right > RIGHT_ENOUGH * preferences:
            return


def _leads(
    network: nn.Sequential, rows: Tensor, asked: Sequence[TableAnswer]
) -> Tensor:
    sides = torch.tensor([[answer.left, answer.right] for answer in asked])
    worth = network(rows[sides]).squeeze(-1).sum(dim=-1)  # [Q, 2]
    return worth[:, 0] - worth[:, 1]
