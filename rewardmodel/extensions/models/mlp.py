"""A small network on the descriptors, for tastes that no weighted sum expresses.

Shapes: M ensemble members, D descriptors.
"""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn.functional import elu

from rewardmodel.cfg import FitCfg
from rewardmodel.extensions_cfg import MlpCfg, NetworkCfg, RawCfg
from rewardmodel.prepared.described import StandardisedPairs
from rewardmodel.prepared.prepared import Prepared

from .network import Network, draw_uniformly, fit_network, glimpses


class MlpScorer(Network):
    """Hidden layers of a member, all members evaluated by one batched product."""

    def __init__(
        self, num_descriptors: int, cfg: NetworkCfg | RawCfg, *, hidden_layers: int = 2
    ) -> None:
        super().__init__()
        sizes = (num_descriptors, *[cfg.hidden_size] * hidden_layers, 1)
        self.weights = nn.ParameterList(
            torch.zeros(cfg.num_members, fan_in, fan_out)
            for fan_in, fan_out in pairwise(sizes)
        )
        self.biases = nn.ParameterList(
            torch.zeros(cfg.num_members, 1, fan_out) for fan_out in sizes[1:]
        )

    bend = staticmethod(elu)
    """What follows a hidden layer."""

    def initialise(self, generator: torch.Generator) -> None:
        """Draw every weight and bias."""
        for weight, bias in zip(self.weights, self.biases, strict=True):
            draw_uniformly(weight, weight.shape[1], generator)
            draw_uniformly(bias, weight.shape[1], generator)

    def forward(self, steps: Tensor, starts: Tensor | None = None) -> Tensor:
        """Raw rewards [M, ...] of standardised descriptors [..., D]."""
        hidden = steps.flatten(0, -2).expand(len(self.weights[0]), -1, -1)
        last = len(self.weights) - 1
        for layer, (weight, bias) in enumerate(
            zip(self.weights, self.biases, strict=True)
        ):
            hidden = torch.baddbmm(bias, hidden, weight)
            if layer < last:
                hidden = self.bend(hidden)
        return hidden.reshape(-1, *steps.shape[:-1])


def fit_mlp(prepared: Prepared, cfg: FitCfg, generator: torch.Generator) -> MlpScorer:
    """Fit each member to its own bootstrap of the answers, by AdamW."""
    pairs = prepared.standardised
    own = cfg.settings_of(MlpCfg)
    scorer = MlpScorer(pairs.steps.shape[-1], own)

    def look(batch: StandardisedPairs, rng: torch.Generator) -> StandardisedPairs:
        return glimpses(batch, own.steps_per_clip, own.min_crop, rng)

    fit_network(scorer, pairs, cfg, own, look=look, generator=generator)
    return scorer
