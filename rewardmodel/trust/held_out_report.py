"""How well held-out answers are foreseen, in all and by their parts.

Every answer is foreseen by a model that has seen neither of its two episodes: by the
reward itself where that is so, else by the model of a fold.

Shapes: B answers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count

import torch
from torch import Tensor

from data.files.telling import Tell, silent
from rewardmodel.answers.answered_pairs import AnsweredPairs
from rewardmodel.cfg import FitCfg
from rewardmodel.linear.noise_level import takes_to_err
from rewardmodel.measures.calibration import (
    Calibration,
    calibration,
    cooled_apart,
    counting,
    fit_temperature,
)
from rewardmodel.measures.held_out import (
    folds_of,
    held_out_predictions,
    prediction_without,
)
from rewardmodel.measures.rater_reliability import Judged, judge
from rewardmodel.models.fit_report import wilson_interval
from rewardmodel.models.kinds import kind_called, prepare
from rewardmodel.models.model import RewardModel
from rewardmodel.models.prediction import Prediction, as_answered
from rewardmodel.posterior.fit_posterior import probably_chance

LEAST_SHARE = 0.6
"""Answers that must be foreseen, however sure it is that some are: a reward that misses
two in five is followed to where it is wrong."""


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

    @property
    def too_low(self) -> bool:
        """Whether a reward that foresees no more is not to be followed."""
        return self.says_nothing or self.share < LEAST_SHARE

    def __str__(self) -> str:
        low, high = self.interval
        return f"{self.share:.2f} ({low:.2f} to {high:.2f}, {self.answers} answers)"


@dataclass(frozen=True, kw_only=True)
class Foreseen:
    """How well held-out answers were foreseen."""

    answers: int
    """Held-out answers, ties included."""
    ties: int
    unseen: int
    """Answers foreseen by the reward itself; the others by models of folds."""
    left_out: int = 0
    """Held-out answers besides, of raters who hardly look."""
    accuracy: Accuracy | None
    """Share of held-out preferences foreseen; None where no held-out answer prefers a
    clip."""
    opinion: Accuracy | None
    """Share of them with each answer counted by the size of its lead; `answers` is how
    many of one size would say as much (Kish 1965, "Survey Sampling")."""
    at_random: Accuracy | None
    """Accuracy on questions drawn at random: how often the reward is right about any
    pair, not only about hard ones."""
    by_chance: float | None
    """Probability that the answers are random, see `probably_chance`; None unless it is
    a posterior with too low an accuracy."""
    newest: Accuracy | None
    """Answers of the newest round, foreseen without any answer of that round; None
    where there is only one round, or no preference in it."""
    by_command: dict[str, Accuracy]
    """By "forward left yaw" in m/s, m/s, rad/s."""
    by_round: dict[str, Accuracy]
    tie_separation: float | None
    """Probability that a tie has the smaller lead than a preference: 0.5 is chance."""
    temperature: float
    """Fitted to all held-out answers, of which those drawn at random count most."""
    uncalibrated: Calibration | None
    """At temperature 1."""
    calibrated: Calibration | None
    """Each answer at the temperature of the answers about other episodes."""


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


def foresee(
    model: RewardModel, pairs: AnsweredPairs, *, seed: int, tell: Tell = silent
) -> Foreseen:
    """How well `pairs` are foreseen by models that have not seen their episodes.

    `tell` gets the models that are fitted: one for each fold, and two about raters and
    the newest round.
    """
    cfg = model.provenance.cfg
    steps = count(1)

    def advance() -> None:
        tell(next(steps), cfg.folds + 2)

    tell(0, cfg.folds + 2)
    seen = model.provenance.episodes
    unseen = torch.tensor([not seen.intersection(pair) for pair in pairs.episodes])
    kind = kind_called(cfg.kind)
    judged = judge(prepare(pairs, cfg), pairs, cfg)
    advance()
    prepared = judged.prepared
    opinion = Prediction.none(len(pairs))
    asked = unseen.clone()
    if not unseen.all():
        held_out, by_fold = held_out_predictions(
            prepared, pairs.episodes, cfg, seed, advance=advance
        )
        opinion.put(held_out, by_fold)
        asked |= held_out
    if unseen.any():
        fresh = pairs.subset(unseen)
        opinion.put(unseen, model.prediction(fresh.left, fresh.right))
    told = asked & judged.measuring
    newest = _newest(judged, torch.tensor(pairs.rounds), cfg, seed)
    advance()
    found = _summary(
        pairs.subset(told) if told.any() else None,
        opinion.subset(told),
        int((unseen & told).sum()),
        newest=newest,
        cfg=cfg,
    )
    found = replace(found, left_out=int(asked.sum() - told.sum()))
    if kind.pooled and found.accuracy and found.accuracy.too_low:
        return replace(found, by_chance=probably_chance(prepared, cfg, seed=seed))
    return found


def _newest(judged: Judged, rounds: Tensor, cfg: FitCfg, seed: int) -> Accuracy | None:
    """Accuracy on the newest round of a model fitted to the rounds before it: what the
    reward that the newest policy was trained on says of that policy's clips."""
    newest = rounds == rounds.max()
    asked = newest & judged.measuring
    if newest.all() or not asked.any():
        return None
    opinion = prediction_without(judged.prepared, ~newest, asked, cfg, seed)
    return accuracy_of(opinion.lead, judged.prepared.described.target[asked])


def _summary(
    pairs: AnsweredPairs | None,
    opinion: Prediction,
    unseen: int,
    *,
    newest: Accuracy | None,
    cfg: FitCfg,
) -> Foreseen:
    """Figures of held-out `pairs`, of which there is an `opinion`."""
    lead, logit, share = opinion.lead, opinion.logit, cfg.error_share
    target = pairs.target if pairs else torch.empty(0)
    episodes = pairs.episodes if pairs else ()
    group = folds_of(episodes, cfg)[:, 0]
    at_random = pairs.at_random if pairs else torch.empty(0, dtype=torch.bool)
    counts = counting(at_random, target, erring=takes_to_err(cfg))
    commands = [_command(row) for row in pairs.commands.tolist()] if pairs else []
    return Foreseen(
        answers=len(target),
        ties=int((target == 0.5).sum()),
        unseen=unseen,
        accuracy=accuracy_of(lead, target),
        opinion=opinion_of(lead, target),
        at_random=accuracy_of(lead[at_random], target[at_random]),
        by_chance=None,
        newest=newest,
        by_command=_apart(commands, lead, target),
        by_round=_apart([str(r) for r in pairs.rounds] if pairs else [], lead, target),
        tie_separation=_tie_separation(lead.abs(), target == 0.5),
        temperature=fit_temperature(logit, target, counts, error_share=share),
        uncalibrated=calibration(as_answered(logit, share), target, counts),
        calibrated=calibration(
            cooled_apart(logit, target, counts, group, error_share=share),
            target,
            counts,
        ),
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
