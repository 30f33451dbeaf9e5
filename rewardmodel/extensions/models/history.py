"""A small network on the last steps at once, for rhythms that no single step shows.

Shapes: M ensemble members, B pairs, T steps, D descriptors, L steps of a window.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from rewardmodel.answers.clip_batch import since_start
from rewardmodel.cfg import FitCfg
from rewardmodel.extensions_cfg import HistoryCfg, SequenceCfg
from rewardmodel.prepared.described import StandardisedPairs
from rewardmodel.prepared.prepared import Prepared
from rewardmodel.scorer import SequenceScorer

from .mlp import MlpScorer
from .network import fit_network, glimpses


def lags_of(cfg: SequenceCfg) -> Tensor:
    """[L] how many steps before a step its window looks, the step itself first."""
    return torch.arange(0, cfg.history_steps + 1, cfg.stride)


def windows(steps: Tensor, lags: Tensor, starts: Tensor | None = None) -> Tensor:
    """Each step with those before it, [..., T, L, D], for steps [..., T, D].

    Nobody looks across a start: before it, the first step of the episode is repeated,
    as if the robot had been like that for ever.

    Args:
        steps: Sequences.
        lags: [L] how many steps before.
        starts: [..., T] bool; None where only the first step of each begins.
    """
    length = steps.shape[-2]
    index = torch.arange(length, device=steps.device)[:, None] - lags
    if starts is None:
        return steps[..., index.clamp_min(0), :]
    index = torch.maximum(index, since_start(starts)[..., None])  # [..., T, L]
    flat = steps.take_along_dim(index.flatten(-2)[..., None], dim=-2)
    return flat.unflatten(-2, (length, len(lags)))


class HistoryScorer(SequenceScorer):
    """A network on windows, all members evaluated by one batched product."""

    def __init__(self, num_descriptors: int, cfg: HistoryCfg) -> None:
        super().__init__()
        self.history_steps = cfg.history_steps
        self.lags: Tensor
        self.register_buffer("lags", lags_of(cfg), persistent=False)
        self.network = MlpScorer(num_descriptors * len(self.lags), cfg)

    def forward(self, steps: Tensor, starts: Tensor | None = None) -> Tensor:
        """Raw rewards [M, ..., T] of standardised sequences [..., T, D]."""
        return self.network(windows(steps, self.lags, starts).flatten(-2))


def fit_history(
    prepared: Prepared, cfg: FitCfg, generator: torch.Generator
) -> HistoryScorer:
    """Fit each member to its own bootstrap of the answers, by AdamW."""
    pairs = prepared.standardised
    own = cfg.settings_of(HistoryCfg)
    scorer = HistoryScorer(pairs.steps.shape[-1], own)
    scorer.network.initialise(generator)

    def look(batch: StandardisedPairs, rng: torch.Generator) -> StandardisedPairs:
        seen = replace(batch, steps=windows(batch.steps, scorer.lags).flatten(-2))
        return glimpses(seen, own.steps_per_clip, own.min_crop, rng)

    fit_network(scorer.network, pairs, cfg, own, look=look, generator=generator)
    return scorer
