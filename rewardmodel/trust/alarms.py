"""When not to trust a reward, and why.

Shapes: T steps, N episodes, F features.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from data.answers.rater_habits import Sides
from rewardmodel.answers.answered_pairs import AnsweredPairs
from rewardmodel.models.model import RewardModel

from .held_out_report import LEAST_SHARE, Accuracy, Foreseen
from .support import Drift, support_of

ENOUGH = 40
"""Answers from which "no better than chance" is a finding: a reward that foresees three
of four answers is then cleared nine times of ten."""
LEAST_OPINION = 0.68
"""The share foreseen, with each answer counted by how sure the model was of it: the
closest questions are asked first, and those it gets wrong may not matter.
`studies.wrong_answers` counts the fits below it that have too low an accuracy too."""
MOST_BY_CHANCE = 0.1
"""Probability that the answers are random, up to which they are believed to mean
something: a style keeps its walk even if they do not."""
FAR_SHARE = 0.9
"""A policy of which more than this is far from every judged clip, or paid more than any
of them, has left what was judged: any that learned something has."""
EXTRAPOLATED = 0.6
"""Standard deviations of reward, paid for what no judged clip shows of some habit, from
which on leaving is no longer believed. Of 176 policies of 13 loops, those of two rounds
that a reward ruined went beyond; the nearest that left, and went well, had 0.5."""
SPREAD_RATIO = 1.5
"""Ensemble spread, over that on the judged clips, that counts as doubt."""

MUCH_DRIFT_NATS = 100.0
"""Nats a step from the policy of the round before (KL divergence) from which on it is
another policy: the retrainings of `make demo` come to 13 to 45. Like the figures below
it raises no alarm and is told."""
MUCH_POWER = 2.0
"""Mechanical power over that of the first policy, where that was trained."""
MUCH_TRACKING_M_S = 0.1
"""Tracking error beyond that of the first policy."""
MUCH_FALLS = 1.0
"""Falls a minute beyond those of the first policy."""


@dataclass(frozen=True, kw_only=True)
class Reach:
    """Where a policy is, seen from the judged clips."""

    drift: Drift | None
    """How far the motion is from what was judged; None where no episode is long
    enough to tell."""
    spread: float
    """Mean ensemble spread on the policy's rows, in units of the reward."""
    spread_judged: float
    """Spread of the members on the judged clips."""

    @property
    def spread_ratio(self) -> float:
        """How much less sure the ensemble is of the policy than of judged clips."""
        return self.spread / max(self.spread_judged, 1e-6)


def reach(
    model: RewardModel, judged: AnsweredPairs, features: Tensor, lengths: Tensor
) -> Reach:
    """Where rows [T, N, F] of episodes with `lengths` [N] are, seen from `judged`."""
    valid = torch.arange(len(features))[:, None] < lengths
    starts = torch.zeros_like(valid)
    starts[0] = True
    return Reach(
        drift=support_of(judged, model).drift(features, valid),
        spread=float(model.spread(features, starts)[valid].mean()),
        spread_judged=judged_spread(model, judged),
    )


def prefers(
    model: RewardModel, features: Tensor, lengths: Tensor, judged: AnsweredPairs
) -> bool:
    """Whether rows [T, N, F] of episodes with `lengths` [N] are paid more than the
    steps people saw of `judged`."""
    valid = torch.arange(len(features))[:, None] < lengths
    starts = torch.zeros_like(valid)
    starts[0] = True
    seen = [
        model.clip_rewards(clips)[0][clips.scored]
        for clips in (judged.left, judged.right)
    ]
    paid = model(features, starts)[valid].mean()
    return bool(paid > torch.cat(seen).mean())


def judged_spread(model: RewardModel, judged: AnsweredPairs) -> float:
    """Mean ensemble spread on the steps people saw, in units of the reward."""
    found = [
        model.clip_rewards(clips)[1][clips.scored]
        for clips in (judged.left, judged.right)
    ]
    return float(torch.cat(found).mean())


def alarms(
    foreseen: Foreseen | None,
    reached: Reach | None,
    *,
    return_rose: bool = True,
    confirmed: bool = False,
    sides: Sequence[Sides] = (),
) -> tuple[str, ...]:
    """Why not to trust the reward, the gravest reason first; none is the hope.

    Args:
        foreseen: How well held-out answers are foreseen; None before a fit.
        reached: Where the policy is; None without one.
        return_rose: Whether the learned return of the policy rose in training. A
            reward that nobody follows misleads nobody.
        confirmed: Whether enough clips of the policy were judged since, and the reward
            fitted to these answers too prefers it to what was judged before.
        sides: Which side of the screen each rater prefers.
    """
    found = list(unforeseen_sides(foreseen, sides))
    if foreseen and disagree(foreseen):
        found.append(
            f"the answers do not agree with one another, or with anything this model "
            f"can see, as if given at random: held-out accuracy {foreseen.accuracy} is "
            f"{_too_low(foreseen.accuracy)}, and counting answers by how sure it is "
            f"helps little: {foreseen.opinion or 'it never is'}{_as_well(foreseen)}"
        )
    newest = foreseen.newest if foreseen else None
    if newest and return_rose and surely_wrong(newest):
        found.append(
            f"the accuracy on the newest clips, {newest}, is worse than chance"
        )
    drift = reached.drift if reached else None
    left = drift is not None and beyond_judgement(drift)
    if reached and drift and left and return_rose and not confirmed:
        found.append(f"the policy does what nobody has judged: {spelled(drift)}")
        if reached.spread_ratio > SPREAD_RATIO:
            found.append(
                f"the ensemble is {reached.spread_ratio:.1f} times less sure of the "
                f"policy than of the judged clips"
            )
    return tuple(found)


def unforeseen_sides(
    foreseen: Foreseen | None, sides: Sequence[Sides]
) -> tuple[str, ...]:
    """Raters whom a side of the screen seems to decide, where the answers are not
    foreseen any better than by chance."""
    accuracy = foreseen.accuracy if foreseen else None
    if accuracy is not None and not accuracy.says_nothing:
        return ()
    return tuple(str(of_rater) for of_rater in sides if of_rater.one_sided)


def tells(accuracy: Accuracy | None) -> bool:
    """Whether so many answers were held out that they can raise an alarm: `ENOUGH`, or
    fewer of which surely less than half are foreseen."""
    if accuracy is None:
        return False
    return accuracy.answers >= ENOUGH or accuracy.interval[1] < 0.5


def disagree(foreseen: Foreseen) -> bool:
    """Whether enough answers were held out to say that they taught too little: it is
    wrong too often, and also where it is sure. Where it explains them better than it
    would explain random ones, neither counts."""
    accuracy, opinion = foreseen.accuracy, foreseen.opinion
    if accuracy is None or not tells(accuracy) or not accuracy.too_low:
        return False
    if foreseen.by_chance is not None and foreseen.by_chance <= MOST_BY_CHANCE:
        return False
    return opinion is None or opinion.says_nothing or opinion.share < LEAST_OPINION


def _too_low(accuracy: Accuracy | None) -> str:
    if accuracy is None or accuracy.says_nothing:
        return "no better than chance"
    return f"below {LEAST_SHARE:g}"


def _as_well(foreseen: Foreseen) -> str:
    if foreseen.by_chance is None:
        return ""
    return f"; they are random with probability {foreseen.by_chance:.2f}"


def surely_wrong(newest: Accuracy) -> bool:
    """Whether surely less than half of the newest answers are foreseen. Half of them
    says nothing: they were asked where the model was in doubt."""
    return newest.interval[1] < 0.5


def beyond_judgement(drift: Drift) -> bool:
    """Whether a policy left what was judged, and is paid for just that."""
    return drift.share_beyond > FAR_SHARE and drift.extrapolated > EXTRAPOLATED


def spelled(drift: Drift) -> str:
    """The drift in words."""
    return (
        f"{drift.share_far:.0%} of its motion is far from every judged clip, "
        f"{drift.share_overpaid:.0%} is paid more than any of them, and "
        f"{drift.extrapolated:.2f} of its reward is for habits beyond their range"
    )
