"""Networks on the last steps at once, for rhythms that no single step shows.

Shapes: M ensemble members, B pairs, T steps, D descriptors, L steps of a window.
"""

from __future__ import annotations

from collections.abc import Callable
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
from .network import Network, fit_network, glimpses


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


class WindowScorer(SequenceScorer):
    """A network that is shown each step with some of those before it."""

    def __init__(self, own: SequenceCfg, make: Callable[[int], Network]) -> None:
        """`make` gives a network for windows of so many steps."""
        super().__init__()
        self.own, self.history_steps = own, own.history_steps
        # The step itself first.
        lags = torch.arange(0, own.history_steps + 1, own.stride)
        self.lags: Tensor
        self.register_buffer("lags", lags, persistent=False)
        self.network = make(len(lags))

    def forward(self, steps: Tensor, starts: Tensor | None = None) -> Tensor:
        """Raw rewards [M, ..., T] of standardised sequences [..., T, D]."""
        return self.network(windows(steps, self.lags, starts))

    def fit(
        self, prepared: Prepared, cfg: FitCfg, generator: torch.Generator
    ) -> WindowScorer:
        """Fit each member to its own bootstrap of the answers, by AdamW."""
        own, lags = self.own, self.lags

        def look(batch: StandardisedPairs, rng: torch.Generator) -> StandardisedPairs:
            seen = replace(batch, steps=windows(batch.steps, lags).flatten(-2))
            seen = glimpses(seen, own.steps_per_clip, own.min_crop, rng)
            return replace(seen, steps=seen.steps.unflatten(-1, (len(lags), -1)))

        pairs = prepared.standardised
        fit_network(self.network, pairs, cfg, own, look=look, generator=generator)
        return self


class SideBySide(MlpScorer):
    """Hidden layers on the steps of a window side by side."""

    def forward(self, steps: Tensor, starts: Tensor | None = None) -> Tensor:
        """Raw rewards [M, ...] of windows [..., L, D]."""
        return super().forward(steps.flatten(-2))


def make_history(cfg: FitCfg, num_descriptors: int) -> WindowScorer:
    """A small network on windows, not fitted yet."""
    own = cfg.settings_of(HistoryCfg)
    return WindowScorer(own, lambda lags: SideBySide(num_descriptors * lags, own))
