"""The one interface to a learned reward, whatever model stands behind it.

Raw rewards are in logits: the difference of two clips' mean raw rewards is the logit
that the left one is better. What PPO gets is centred and scaled once, at the fit.

Shapes: M ensemble members, B clips, T steps, N environments, F features,
D descriptors, K steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor, nn

from rewardmodel.answers.clip_batch import ClipBatch, mean_over
from rewardmodel.cfg import FitCfg
from rewardmodel.descriptors.normaliser import Normaliser, fill_missing
from rewardmodel.descriptors.table import Sight, describe, names_seen
from rewardmodel.prepared.described import DescribedPairs, StandardisedPairs
from rewardmodel.scorer import Scorer

from .fit_report import FitReport
from .kinds import kind_called
from .prediction import Prediction, as_answered

_MIN_STD = 1e-4
"""Raw rewards, in logits, that vary less than this are no opinion."""
StepRewards = Callable[[StandardisedPairs], Tensor]
"""Raw rewards [..., K] of the steps that count."""


def leads_of_pairs(scorer: Scorer, pairs: StandardisedPairs) -> Tensor:
    """Logit [M, B], by member, that left clips of standardised `pairs` are better."""
    before = pairs.lift_offs_before
    return pairs.leads(lambda steps: scorer.of_clips(steps, pairs.scored, before))


def leads_by(scorer: Scorer, pairs: DescribedPairs, normaliser: Normaliser) -> Tensor:
    """As `leads_of_pairs`, of `pairs` standardised by `normaliser`, some at a time."""
    parts = (part.standardised(normaliser) for part in pairs.parts())
    return torch.cat([leads_of_pairs(scorer, part) for part in parts], dim=1)


def predict_pairs(scorer: Scorer, pairs: StandardisedPairs) -> Prediction:
    """What is paid, and what members say, of left clips of standardised `pairs`."""
    leads, payer = leads_of_pairs(scorer, pairs), scorer.payer
    paid = leads if payer is scorer else leads_of_pairs(payer, pairs)
    return Prediction.of(paid.mean(dim=0), leads)


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
    `starts` marks first steps of episodes, which models that look back do not look
    across.
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

    @property
    def history_steps(self) -> int:
        """Steps before a step that matter to its reward."""
        return self.scorer.history_steps

    @property
    def payer(self) -> Scorer:
        """The ensemble whose mean is paid; `scorer` is the one whose members differ."""
        return self.scorer.payer

    @property
    def names(self) -> tuple[str, ...]:
        """What the model looks at, a name for each of its D numbers."""
        return names_seen(self.sight)

    @property
    def sight(self) -> Sight:
        """What the model sees."""
        return kind_called(self.provenance.cfg.kind).sight

    def calibrate(self, pairs: DescribedPairs) -> RewardModel:
        """Freeze centre and scale on the steps of described pairs.

        A model without any opinion gives reward 0 rather than magnified noise. Where
        another than the members is paid, the deviation is that of a member.
        """
        agreed = self._of_parts(pairs, self._agreed)
        std, mean = torch.std_mean(agreed, correction=0)
        if self.payer is not self.scorer:
            own = self._of_parts(pairs, partial(_in_clips, self.scorer))
            std = std * _contradicted(own)
        self.reward_mean.copy_(mean)
        self.reward_std.copy_(std if std > _MIN_STD else torch.ones(()))
        return self

    def _of_parts(self, pairs: DescribedPairs, rewards: StepRewards) -> Tensor:
        """`rewards` [..., K] of all pairs, some at a time."""
        parts = (part.standardised(self.normaliser) for part in pairs.parts())
        return torch.cat([rewards(part) for part in parts], dim=-1)

    def _agreed(self, pairs: StandardisedPairs) -> Tensor:
        """Raw reward [K] of every step that counts, as the members agree on it."""
        if self.history_steps:
            return _in_clips(self.payer, pairs).mean(dim=0)
        return self.scorer(pairs.scored_steps).mean(dim=0)

    def standardised(self, features: Tensor) -> Tensor:
        """What the model sees [..., D] of rows [..., F]."""
        return self.normaliser(describe(features, self.sight))

    def members(self, features: Tensor, starts: Tensor) -> Tensor:
        """Raw reward [M, T, N] of every member for rows [T, N, F]."""
        return self._of_rows(self.scorer, features, starts)

    def forward(self, features: Tensor, starts: Tensor) -> Tensor:
        """Reward [T, N]: what the ensemble agrees on, centred, unit deviation on the
        fitted clips."""
        return self.reward_of(self._of_rows(self.payer, features, starts))

    def _of_rows(self, scorer: Scorer, features: Tensor, starts: Tensor) -> Tensor:
        return scorer.of_rows(self.standardised(features), starts)

    def centred(self, raw: Tensor) -> Tensor:
        """Reward [...] of a raw one, [...], that members agreed on."""
        return (raw - self.reward_mean) / self.reward_std

    def reward_of(self, raw: Tensor) -> Tensor:
        """Reward [...] of what the members of `payer` give, raw [M, ...]."""
        return self.centred(raw.mean(dim=0))

    def spread_of(self, raw: Tensor) -> Tensor:
        """Standard deviation [...] of what the members give, in units of the reward."""
        return raw.std(dim=0) / self.reward_std

    def spread(self, features: Tensor, starts: Tensor) -> Tensor:
        """Standard deviation [T, N] over the members, in units of the reward."""
        return self.spread_of(self.members(features, starts))

    def leads(self, left: ClipBatch, right: ClipBatch) -> Tensor:
        """Logit [M, B], by member, that each left clip is better than the right one."""
        return self.clip_returns(left) - self.clip_returns(right)

    def lead(self, left: ClipBatch, right: ClipBatch) -> Tensor:
        """Logit [B] of what is paid that each left clip is the better one."""
        worth = [
            self._returns(self.payer, clips).mean(dim=0) for clips in (left, right)
        ]
        return worth[0] - worth[1]

    def logit(self, left: ClipBatch, right: ClipBatch) -> Tensor:
        """Calibrated logit [B] that each left clip is called better."""
        made = self.provenance
        cooled = self.prediction(left, right).logit / made.report.temperature
        return as_answered(cooled, made.cfg.error_share)

    def prediction(self, left: ClipBatch, right: ClipBatch) -> Prediction:
        """On left clips [B] beside the right ones."""
        return Prediction.of(self.lead(left, right), self.leads(left, right))

    def clip_returns(self, clips: ClipBatch) -> Tensor:
        """Mean raw reward [M, B] of clips, less the fixed price of a fall."""
        return self._returns(self.scorer, clips)

    def clip_worths(
        self, clips: ClipBatch, rng: np.random.Generator
    ) -> tuple[Tensor, Tensor]:
        """What clips are worth to some who could have answered as was answered: logits
        [M, B], and the share [M] of their answers that are random. `rng` draws who."""
        cfg = self.provenance.cfg
        told = self.scorer.worths(*self._laid(clips), rng)
        if told is None:
            returns = self.clip_returns(clips)
            return returns, torch.full((len(returns),), cfg.error_share)
        worth, share = (each.cpu() for each in told)
        return worth - cfg.fall_logit * clips.fell, share

    def _returns(self, scorer: Scorer, clips: ClipBatch) -> Tensor:
        rewards = self._of_clips(scorer, clips).cpu()
        price = self.provenance.cfg.fall_logit
        return mean_over(rewards, clips.scored) - price * clips.fell.float()

    def clip_rewards(self, clips: ClipBatch) -> tuple[Tensor, Tensor]:
        """Reward [B, T] of every step of clips, and its spread over the members."""
        raw, payer = self._of_clips(self.scorer, clips), self.payer
        paid = raw if payer is self.scorer else self._of_clips(payer, clips)
        return self.reward_of(paid).cpu(), self.spread_of(raw).cpu()

    def episode_rewards(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Reward [T] of every step of a whole episode, rows [T, F], as training pays
        it, and its spread over the members; what nobody measured counts as average."""
        steps = fill_missing(self.standardised(rows))
        starts = torch.arange(len(rows), device=rows.device) == 0
        raw, payer = self.scorer(steps, starts), self.payer
        paid = raw if payer is self.scorer else payer(steps, starts)
        return self.reward_of(paid), self.spread_of(raw)

    def _of_clips(self, scorer: Scorer, clips: ClipBatch) -> Tensor:
        """Raw reward [M, B, T], where the model lives, of clips on the CPU."""
        return scorer.of_clips(*self._laid(clips))

    def _laid(self, clips: ClipBatch) -> tuple[Tensor, Tensor, Tensor | None]:
        """What a scorer wants of clips; descriptors a clip lacks are at their mean."""
        device, before = self.reward_mean.device, clips.lift_offs_before
        steps = fill_missing(self.standardised(clips.features.to(device)))
        if before is not None:
            before = before.to(device)
        return steps, clips.scored.to(device), before


def _in_clips(scorer: Scorer, pairs: StandardisedPairs) -> Tensor:
    """Raw reward [M, K] of every step that counts, as part of its clip."""
    rewards = scorer.of_clips(pairs.steps, pairs.scored, pairs.lift_offs_before)
    return rewards[:, pairs.scored]


def _contradicted(rewards: Tensor) -> Tensor:
    """How much less the mean of members varies than they do, of what each gives [M, K],
    from 1 up: what they disagree about is not scaled up again."""
    of_all = rewards.mean(dim=0).std(correction=0).clamp_min(_MIN_STD)
    return (rewards.std(dim=1, correction=0).mean() / of_all).clamp_min(1)
