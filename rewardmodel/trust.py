"""How far a reward can be trusted, and when not to.

Every answer is foreseen by a model that has seen neither of its two episodes: by the
reward itself where that is so, else by the model of a fold.

Shapes: B answers, T steps, N episodes, F features.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from .calibration import Calibration, calibration, fit_temperature
from .cfg import FitCfg
from .held_out import fold_of, held_out_leads, leads_without
from .model import RewardModel
from .pairs import AnsweredPairs
from .reliability import with_reliability
from .report import wilson_interval
from .support import Drift, support_of
from .training import TrainingPairs, training_pairs

ENOUGH = 40
"""Answers from which "no better than chance" is a finding: a reward that foresees three
of four answers is then cleared nine times of ten."""
LEAST_SHARE = 0.6
"""Answers that must be foreseen, however sure it is that some are: a reward that misses
two in five is followed to where it is wrong."""
LEAST_OPINION = 0.7
"""The same share with each answer counted by how sure the model was of it: the closest
questions are asked first, and those it gets wrong may not matter."""
ENOUGH_NEWEST = 10
"""The same for the answers of the newest round alone, where the share itself must not
exceed one half."""
FAR_SHARE = 0.9
"""A policy of which more than this is far from every judged clip, or paid more than any
of them, has left what was judged: any that learned something has."""
EXTRAPOLATED = 0.6
"""Standard deviations of reward, paid for what no judged clip shows of some habit, from
which on leaving is no longer believed: see docs/trust.md for where this comes from."""
SPREAD_RATIO = 1.5
"""Ensemble spread, over that on the judged clips, that counts as doubt."""


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """Preferences foreseen; ties are neither right nor wrong."""

    share: float
    """A model without an opinion is half right."""
    interval: tuple[float, float]
    """Wilson 95 % interval."""
    answers: int
    """Preferences counted."""

    @property
    def says_nothing(self) -> bool:
        """Whether guessing would do as well, as far as one can tell."""
        return self.interval[0] <= 0.5


@dataclass(frozen=True, kw_only=True)
class Foreseen:
    """How well held-out answers were foreseen."""

    answers: int
    """Held-out answers, ties included."""
    ties: int
    unseen: int
    """Of these, foreseen by the reward itself; the others by models of folds."""
    accuracy: Accuracy | None
    """None where no held-out answer prefers a clip."""
    opinion: Accuracy | None
    """The same, each answer counted by the size of its lead; `answers` is how many of
    one size would say as much (Kish 1965, "Survey Sampling")."""
    newest: Accuracy | None
    """Answers of the newest round, foreseen without any answer of that round; None
    where there is only one round, or no preference in it."""
    by_command: dict[str, Accuracy]
    """By "forward left yaw" in m/s, m/s, rad/s."""
    by_round: dict[str, Accuracy]
    tie_separation: float | None
    """Probability that a tie has the smaller lead than a preference: 0.5 is chance."""
    temperature: float
    """Fitted to all held-out answers."""
    uncalibrated: Calibration | None
    """At temperature 1."""
    calibrated: Calibration | None
    """Each answer at the temperature of the answers about other episodes."""


@dataclass(frozen=True, kw_only=True)
class Reach:
    """Where a policy is, seen from the judged clips."""

    drift: Drift | None
    """None where no episode is long enough to tell."""
    spread: float
    """Mean ensemble spread on the policy's rows, in units of the reward."""
    spread_judged: float
    """The same on the judged clips."""

    @property
    def spread_ratio(self) -> float:
        """How much less sure the ensemble is of the policy than of judged clips."""
        return self.spread / max(self.spread_judged, 1e-6)


def accuracy_of(lead: Tensor, target: Tensor) -> Accuracy | None:
    """Accuracy of leads [B]; None without any preference."""
    preference = target != 0.5
    total = int(preference.sum())
    if not total:
        return None
    right = ((lead > 0) == (target > 0.5)).double()
    halves = torch.where(lead == 0, 0.5, right)[preference].sum()
    interval = wilson_interval(float(halves), total)
    return Accuracy(share=float(halves) / total, interval=interval, answers=total)


def opinion_of(lead: Tensor, target: Tensor) -> Accuracy | None:
    """Accuracy of leads [B], each counted by its size; None without a preference that
    any lead is about."""
    size = lead.abs().double()[target != 0.5]
    if not size.sum() > 0:
        return None
    right = ((lead > 0) == (target > 0.5))[target != 0.5]
    alike = max(1, round(float(size.sum() ** 2 / size.square().sum())))
    share = float((size * right).sum() / size.sum())
    interval = wilson_interval(share * alike, alike)
    return Accuracy(share=share, interval=interval, answers=alike)


def foresee(model: RewardModel, pairs: AnsweredPairs, *, seed: int) -> Foreseen:
    """How well `pairs` are foreseen by models that have not seen their episodes."""
    cfg = model.provenance.cfg
    seen = model.provenance.episodes
    unseen = torch.tensor([not seen.intersection(pair) for pair in pairs.episodes])
    described, _ = with_reliability(
        training_pairs(pairs, cfg), pairs.raters, cfg, seed=seed
    )
    lead = torch.zeros(len(pairs))
    asked = unseen.clone()
    if not unseen.all():
        held_out, by_fold = held_out_leads(described, pairs.episodes, cfg, seed)
        lead[held_out] = by_fold
        asked |= held_out
    if unseen.any():
        fresh = pairs.subset(unseen)
        lead[unseen] = model.leads(fresh.left, fresh.right).mean(dim=0)
    return _summary(
        pairs.subset(asked) if asked.any() else None,
        lead[asked],
        int(unseen.sum()),
        newest=_newest(described, torch.tensor(pairs.rounds), cfg, seed),
        folds=cfg.folds,
    )


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


def judged_spread(model: RewardModel, judged: AnsweredPairs) -> float:
    """Mean ensemble spread on the steps people saw, in units of the reward."""
    found = [
        model.spread(clips.features.transpose(0, 1), clips.starts.mT)[clips.scored.mT]
        for clips in (judged.left, judged.right)
    ]
    return float(torch.cat(found).mean())


def alarms(
    foreseen: Foreseen | None, reached: Reach | None, *, return_rose: bool = True
) -> tuple[str, ...]:
    """Why not to trust the reward, the gravest reason first; none is the hope.

    Args:
        foreseen: How well held-out answers are foreseen; None before a fit.
        reached: Where the policy is; None without one.
        return_rose: Whether the learned return of the policy rose in training. A
            reward that nobody follows misleads nobody.
    """
    found = []
    if foreseen and disagree(foreseen):
        found.append(
            f"the answers do not agree with one another, or with anything this model "
            f"can see: held-out accuracy {_spelled(foreseen.accuracy)} is "
            f"{_too_low(foreseen.accuracy)}, and counting answers by how sure it is "
            f"helps little: {_spelled(foreseen.opinion)}"
        )
    newest = foreseen.newest if foreseen else None
    if newest and return_rose and _no_better(newest):
        found.append(
            f"the accuracy on the newest clips, {_spelled(newest)}, is no better than "
            f"chance"
        )
    drift = reached.drift if reached else None
    if reached and drift and return_rose and beyond_judgement(drift):
        found.append(f"the policy does what nobody has judged: {spelled(drift)}")
        if reached.spread_ratio > SPREAD_RATIO:
            found.append(
                f"the ensemble is {reached.spread_ratio:.1f} times less sure of the "
                f"policy than of the judged clips"
            )
    return tuple(found)


def disagree(foreseen: Foreseen) -> bool:
    """Whether enough answers were held out to say that they taught too little: it is
    wrong too often, and also where it is sure."""
    accuracy, opinion = foreseen.accuracy, foreseen.opinion
    if accuracy is None or accuracy.answers < ENOUGH:
        return False
    if not (accuracy.says_nothing or accuracy.share < LEAST_SHARE):
        return False
    return opinion is None or opinion.says_nothing or opinion.share < LEAST_OPINION


def _too_low(accuracy: Accuracy | None) -> str:
    if accuracy is None or accuracy.says_nothing:
        return "no better than chance"
    return f"below {LEAST_SHARE:g}"


def _no_better(newest: Accuracy) -> bool:
    return newest.answers >= ENOUGH_NEWEST and newest.share <= 0.5


def beyond_judgement(drift: Drift) -> bool:
    """Whether a policy left what was judged, and is paid for just that."""
    return left_for_pay(drift, FAR_SHARE)


def left_for_pay(drift: Drift, share: float) -> bool:
    """Whether more than `share` of the motion is beyond what was judged, and the reward
    of it is largely a guess."""
    return drift.share_beyond > share and drift.extrapolated > EXTRAPOLATED


def spelled(drift: Drift) -> str:
    """The drift in words."""
    return (
        f"{drift.share_far:.0%} of its motion is far from every judged clip, "
        f"{drift.share_overpaid:.0%} is paid more than any of them, and "
        f"{drift.extrapolated:.2f} of its reward is for habits beyond their range"
    )


def _spelled(accuracy: Accuracy | None) -> str:
    if accuracy is None:
        return "unknown"
    low, high = accuracy.interval
    return f"{accuracy.share:.2f} ({low:.2f} to {high:.2f}, {accuracy.answers} answers)"


def _newest(
    described: TrainingPairs, rounds: Tensor, cfg: FitCfg, seed: int
) -> Accuracy | None:
    """Accuracy on the newest round of a model fitted to the rounds before it: what the
    reward that the newest policy was trained on says of that policy's clips."""
    newest = rounds == rounds.max()
    if newest.all():
        return None
    lead = leads_without(described, ~newest, newest, cfg, seed)
    return accuracy_of(lead, described.target[newest])


def _summary(
    pairs: AnsweredPairs | None,
    lead: Tensor,
    unseen: int,
    *,
    newest: Accuracy | None,
    folds: int,
) -> Foreseen:
    """Figures of held-out `pairs`, which their leads [B] foresee."""
    target = pairs.target if pairs else torch.empty(0)
    episodes = pairs.episodes if pairs else ()
    group = torch.tensor([fold_of(left, folds) for left, _ in episodes])
    cooled = lead.clone()
    for fold in range(folds):
        cooled[group == fold] /= fit_temperature(
            lead[group != fold], target[group != fold]
        )
    commands = [_command(row) for row in pairs.commands.tolist()] if pairs else []
    return Foreseen(
        answers=len(target),
        ties=int((target == 0.5).sum()),
        unseen=unseen,
        accuracy=accuracy_of(lead, target),
        opinion=opinion_of(lead, target),
        newest=newest,
        by_command=_apart(commands, lead, target),
        by_round=_apart([str(r) for r in pairs.rounds] if pairs else [], lead, target),
        tie_separation=_tie_separation(lead.abs(), target == 0.5),
        temperature=fit_temperature(lead, target),
        uncalibrated=calibration(lead, target),
        calibrated=calibration(cooled, target),
    )


def _command(row: Sequence[float]) -> str:
    return " ".join(f"{value + 0.0:.2f}" for value in row)


def _apart(labels: Sequence[str], lead: Tensor, target: Tensor) -> dict[str, Accuracy]:
    """Accuracy of the answers of each label, in the order of the labels."""
    found = {}
    for label in sorted(set(labels)):
        own = torch.tensor([other == label for other in labels])
        accuracy = accuracy_of(lead[own], target[own])
        if accuracy is not None:
            found[label] = accuracy
    return found


def _tie_separation(lead: Tensor, tie: Tensor) -> float | None:
    """Share of ties beside preferences in which the tie has the smaller lead."""
    if not tie.any() or tie.all():
        return None
    gap = lead[~tie][:, None] - lead[tie]
    return float((gap > 0).double().mean() + 0.5 * (gap == 0).double().mean())
