"""Where on the range of each habit a clip spends its time.

Every curve is kept as its values at evenly spread nodes, and straight in between. So
the mean of a curve over a clip is the product of those values with how much of the clip
is near each node, which is found once for all curves.

Shapes: B clips, T steps, G habits, K nodes.
"""

from __future__ import annotations

import torch
from torch import Tensor

NODES = torch.linspace(-0.5, 1.5, 81)
"""[K] on the range: half of it is added at either end."""
_SPACING = float(NODES[1] - NODES[0])
_AT_ONCE = 128
"""Clips looked at together, some 10 MB."""


def near_nodes(places: Tensor) -> tuple[Tensor, Tensor]:
    """Node below `places` [...], at most the last but one, and how far on the way to
    the next one, from 0 to 1, a place is; beyond the nodes it is the last of them."""
    along = (places.clamp(NODES[0], NODES[-1]) - NODES[0]) / _SPACING
    node = along.floor().clamp(max=len(NODES) - 2)
    return node.long(), along - node


def occupancy(places: Tensor, scored: Tensor) -> Tensor:
    """[B, G, K] share of the steps `scored` [B, T] of a clip near each node; 0 for a
    clip without any.

    Args:
        places: [B, T, G] on the ranges.
        scored: [B, T] bool.
    """
    count, _, habits = places.shape
    found = torch.zeros(count, habits, len(NODES))
    steps = scored.sum(dim=1).clamp_min(1)
    for chosen in torch.arange(count).split(_AT_ONCE):
        node, on = near_nodes(places[chosen].mT)
        weight = (scored[chosen] / steps[chosen, None])[:, None].expand_as(on)
        part = torch.zeros(len(chosen), habits, len(NODES))
        part.scatter_add_(2, node, weight * (1 - on))
        part.scatter_add_(2, node + 1, weight * on)
        found[chosen] = part
    return found


def along(table: Tensor, places: Tensor) -> Tensor:
    """Sum over the habits of curves, [M, ...], at `places` [..., G].

    Args:
        table: [M, G, K] values at the nodes; habits whose curves are 0 cost nothing.
        places: On the ranges.
    """
    used = (table != 0).flatten(2).any(dim=2).any(dim=0).nonzero()[:, 0].tolist()
    total = places.new_zeros(*places.shape[:-1], len(table))
    for habit in used:
        node, on = near_nodes(places[..., habit])
        curve = table[:, habit].mT.contiguous()  # [K, M]
        total += torch.lerp(curve[node], curve[node + 1], on[..., None])
    return total.movedim(-1, 0)
