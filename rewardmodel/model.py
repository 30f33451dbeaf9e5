"""The one interface to a learned reward, whatever model stands behind it.

Raw rewards are in logits: the difference of two clips' mean raw rewards is the logit
that the left one is better. What PPO gets is centred and scaled once, at the fit.

Shapes: M ensemble members, B clips, T steps, N environments, F features,
D descriptors, K steps.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from .cfg import FitCfg
from .clips import ClipBatch, mean_over
from .descriptors import DESCRIPTORS, describe
from .gp import GpScorer
from .linear import LinearScorer
from .mlp import MlpScorer
from .normaliser import Normaliser, fill_missing
from .report import FitReport

_MIN_STD = 1e-4
"""Raw rewards, in logits, that vary less than this are no opinion."""

Scorer = LinearScorer | GpScorer | MlpScorer
"""Standardised descriptors [..., D] to raw rewards [M, ...] of all members at once."""


def make_scorer(cfg: FitCfg) -> Scorer:
    """An unfitted model of the kind and sizes `cfg` asks for: raw reward 0.

    Raises:
        ValueError: the kind is still to be chosen.
    """
    if cfg.kind == "mlp":
        return MlpScorer(cfg.mlp.num_members, len(DESCRIPTORS), cfg.mlp.hidden_size)
    if cfg.kind == "gp":
        return GpScorer(cfg.gp.num_members, len(DESCRIPTORS), cfg.gp.num_features)
    if cfg.kind == "auto":
        raise ValueError("`auto` is no model: a fit says which one it chose")
    return LinearScorer(cfg.linear.num_members, len(DESCRIPTORS))


@dataclass(frozen=True)
class Provenance:
    """What a reward model was made from and how."""

    cfg: FitCfg
    report: FitReport
    answers_sha256: str
    """Hash of the answers it was fitted to."""
    episodes: frozenset[str]
    """SHA-256 of the episodes in those answers: whatever else is held out."""


class RewardModel(nn.Module):
    """An ensemble that turns feature rows into a reward, in one batched pass.

    A reward function like any other: `(features [T, N, F], starts [T, N]) -> [T, N]`.
    `starts` marks first steps of episodes, for models that look back; those behind this
    class so far look at one step and never read it.
    """

    def __init__(
        self, normaliser: Normaliser, scorer: Scorer, provenance: Provenance
    ) -> None:
        super().__init__()
        self.normaliser = normaliser
        self.scorer = scorer
        self.provenance = provenance
        self.reward_mean: Tensor
        self.reward_std: Tensor
        self.register_buffer("reward_mean", torch.zeros(()))
        self.register_buffer("reward_std", torch.ones(()))
        self.requires_grad_(False)

    def calibrate(self, steps: Tensor) -> RewardModel:
        """Freeze centre and scale on standardised descriptors [K, D] of fitted steps.

        A model without any opinion gives reward 0 rather than magnified noise.
        """
        std, mean = torch.std_mean(self.scorer(steps).mean(dim=0), correction=0)
        self.reward_mean.copy_(mean)
        self.reward_std.copy_(std if std > _MIN_STD else torch.ones(()))
        return self

    def members(self, features: Tensor, starts: Tensor) -> Tensor:
        """Raw reward [M, T, N] of every member for rows [T, N, F]."""
        return self.scorer(self.normaliser(describe(features)))

    def forward(self, features: Tensor, starts: Tensor) -> Tensor:
        """Reward [T, N]: ensemble mean, centred, unit deviation on the fitted clips."""
        mean = self.members(features, starts).mean(dim=0)
        return (mean - self.reward_mean) / self.reward_std

    def spread(self, features: Tensor, starts: Tensor) -> Tensor:
        """Standard deviation [T, N] over the members, in units of the reward."""
        return self.members(features, starts).std(dim=0) / self.reward_std

    def leads(self, left: ClipBatch, right: ClipBatch) -> Tensor:
        """Logit [M, B], by member, that each left clip is better than the right one."""
        return self.clip_returns(left) - self.clip_returns(right)

    def probabilities(self, left: ClipBatch, right: ClipBatch) -> Tensor:
        """Calibrated probability [B] that each left clip is called better."""
        lead = self.leads(left, right).mean(dim=0)
        return (lead / self.provenance.report.temperature).sigmoid()

    def clip_returns(self, clips: ClipBatch) -> Tensor:
        """Mean raw reward [M, B] of clips, less the fixed price of a fall."""
        rewards = self._clip_members(clips)
        price = self.provenance.cfg.fall_logit
        return mean_over(rewards, clips.scored) - price * clips.fell.float()

    def clip_rewards(self, clips: ClipBatch) -> tuple[Tensor, Tensor]:
        """Reward [B, T] of every step of clips, and its spread over the members."""
        rewards = self._clip_members(clips)
        mean = (rewards.mean(dim=0) - self.reward_mean.cpu()) / self.reward_std.cpu()
        return mean, rewards.std(dim=0) / self.reward_std.cpu()

    def _clip_members(self, clips: ClipBatch) -> Tensor:
        """Raw reward [M, B, T]; descriptors a clip lacks are at their mean.

        Wherever the model lives, clips and result live on the CPU.
        """
        features = clips.features.to(self.reward_mean.device)
        steps = fill_missing(self.normaliser(describe(features)))
        return self.scorer(steps).cpu()
