"""Two critics as one network: what an action is worth, by two opinions.

Shapes: B steps, D numbers of an observation, two critics in front.
"""

from __future__ import annotations

import math
from itertools import pairwise

import torch
from torch import Tensor, nn


class TwinCritic(nn.Module):
    """Observations [B, D], normalised, and actions [B, 12] in shares of their bound to
    values [2, B].

    Layers are normalised (Ball et al. 2023, arXiv 2302.02948): what a critic thinks of
    actions nobody tried cannot grow without end.
    """

    def __init__(self, obs_dim: int, sizes: tuple[int, ...]) -> None:
        super().__init__()
        widths = (obs_dim + 12, *sizes, 1)
        self.weights = nn.ParameterList()
        self.biases = nn.ParameterList()
        for a, b in pairwise(widths):
            reach = 1.0 / math.sqrt(a)
            self.weights.append(torch.empty(2, a, b).uniform_(-reach, reach))
            self.biases.append(torch.empty(2, 1, b).uniform_(-reach, reach))

    def forward(self, obs: Tensor, action: Tensor) -> Tensor:
        """See the class."""
        x = torch.cat([obs, action], dim=-1).expand(2, -1, -1)
        last = len(self.weights) - 1
        for index, (weight, bias) in enumerate(
            zip(self.weights, self.biases, strict=True)
        ):
            x = torch.baddbmm(bias, x, weight)
            if index < last:
                x = nn.functional.layer_norm(x, x.shape[-1:])
                x = nn.functional.elu(x)
        return x[..., 0]
