"""How much the answer to a question would tell of what somebody wants.

A question is worth the mutual information of its answer with the answers to others
(expected predictive information gain, Bickford Smith et al. 2023): half of those are
about any two clips, half are duels of clips that some particle likes best. Of what
nobody would be asked or shown, nothing needs to be known.

Shapes: M members or particles, C clips, K questions, Q targets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from data.episodes.clips import Clip
from rewardmodel.answers.clip_batch import ClipRows, read_clips
from rewardmodel.models.model import RewardModel

_TARGETS = 300
"""Targets of either half."""
_LEAST = 1e-9


@dataclass(frozen=True)
class Information:
    """Nats that the answer tells of the answers to other questions."""

    model: RewardModel
    clip_rows: ClipRows
    name: str = "information"

    def __call__(
        self, clips: Sequence[Clip], candidates: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        batch = read_clips(clips, self.clip_rows)
        worth, share = self.model.clip_worths(batch, rng)
        return information(worth, share, torch.from_numpy(candidates), rng).numpy()


def information(
    worth: Tensor, error_share: Tensor, questions: Tensor, rng: np.random.Generator
) -> Tensor:
    """Nats [K] that the answer to each question tells of the answers to others.

    Args:
        worth: [M, C] what particles think of clips, in logits.
        error_share: [M] of their answers that are random.
        questions: [K, 2] pairs of clips that may be compared.
        rng: Draws the targets.
    """
    targets = _targets(worth, questions, rng)
    answer = _left(worth, questions)
    answer = (1 - error_share[:, None]) * answer + error_share[:, None] / 2
    other = _left(worth, targets)
    both = answer.mT @ other / len(worth)
    p, q = answer.mean(dim=0)[:, None], other.mean(dim=0)
    total = torch.zeros(len(questions))
    for joint, apart in (
        (both, p * q),
        (p - both, p * (1 - q)),
        (q - both, (1 - p) * q),
        (1 - p - q + both, (1 - p) * (1 - q)),
    ):
        joint = joint.clamp_min(_LEAST)
        total += (joint * (joint / apart.clamp_min(_LEAST)).log()).mean(dim=1)
    return total


def _left(worth: Tensor, pairs: Tensor) -> Tensor:
    """[M, K] probability that the left of pairs [K, 2] is better."""
    left, right = pairs.mT
    return (worth[:, left] - worth[:, right]).sigmoid()


def _targets(worth: Tensor, questions: Tensor, rng: np.random.Generator) -> Tensor:
    """[Q, 2] questions at random, and duels of the clips that two members like best
    among those that can be compared."""
    duels = []
    for own in _groups(questions, worth.shape[1]):
        best = own[worth[:, own].argmax(dim=1)]
        shuffled = best[torch.from_numpy(rng.permutation(len(best)))]
        duels.append(shuffled[: len(best) // 2 * 2].view(-1, 2))
    duel = torch.cat(duels)
    duel = duel[duel[:, 0] != duel[:, 1]]
    some, others = (
        each[torch.from_numpy(rng.permutation(len(each))[:_TARGETS])]
        for each in (questions, duel)
    )
    return torch.cat([some, others])


def _groups(questions: Tensor, num_clips: int) -> list[Tensor]:
    """Clips that some chain of questions [K, 2] joins."""
    group = torch.arange(num_clips)
    while True:
        lower = group[questions].amin(dim=1)
        joined = group.clone()
        for side in questions.mT:
            joined.scatter_reduce_(0, side, lower, "amin")
        if torch.equal(joined, group):
            break
        group = joined
    used = questions.unique()
    return [used[group[used] == number] for number in group[used].unique()]
