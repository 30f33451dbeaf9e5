"""Fitting a reward to answers, and measuring it on episodes it has not seen.

Shapes: M ensemble members, B pairs.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import replace
from typing import get_args

import torch
from torch import Tensor

from rewardmodel.answers.answered_pairs import AnsweredPairs
from rewardmodel.cfg import CHOSEN_FROM, KindName
from rewardmodel.cfg import FitCfg as FitCfg
from rewardmodel.extensions.answers.label_filter import without_doubted
from rewardmodel.extensions.answers.model_choice import choose
from rewardmodel.extensions.semi_supervised import Unanswered
from rewardmodel.linear.linear import members_for
from rewardmodel.linear.noise_level import (
    errors_alike,
    noise_level,
    settled,
    takes_to_err,
)
from rewardmodel.measures.calibration import (
    calibration,
    cooled_apart,
    counting,
    fit_temperature,
)
from rewardmodel.measures.held_out import folds_of, held_out_predictions
from rewardmodel.measures.rater_reliability import Judged, judge
from rewardmodel.models.ensemble import fit_ensemble
from rewardmodel.models.fit_report import FitReport as FitReport
from rewardmodel.models.fit_report import wilson_interval
from rewardmodel.models.kinds import KINDS, kind_called, make_scorer, prepare
from rewardmodel.models.model import Provenance, RewardModel, leads_by
from rewardmodel.models.prediction import Prediction
from rewardmodel.prepared.described import ClipPairs
from rewardmodel.prepared.prepared import Prepared

from .stopping import enough, remaining

logger = logging.getLogger(__name__)


def fit_reward(
    pairs: AnsweredPairs,
    cfg: FitCfg,
    *,
    seed: int,
    measured: bool = True,
    unanswered: AnsweredPairs | None = None,
    advance: Callable[[], None] = lambda: None,
) -> tuple[RewardModel, FitReport]:
    """Fit a reward to all answers, and once more without each fold to measure it.

    Where the model is to be chosen, held-out answers choose it; how often answers are
    wrong, and how strong opinions may be, is then found from them, and where several
    raters answered how reliable each is. The reward's own settings name what was found.
    Equal pairs, settings and seed give equal bytes. Answers that prefer nothing make no
    reward: what is expected before any answer is no wish of anybody.

    Args:
        pairs: The answers.
        cfg: Which model, and how it is fitted.
        seed: Bootstrap draws and first weights.
        measured: Off, no fold is fitted: the same reward in a fraction of the time,
            for those who only ask where it is in doubt. It is then not calibrated,
            and `auto` takes the stiffest model.
        unanswered: Pairs nobody answered, for `cfg.semi_supervised`. Those with a clip
            in a fold are kept from the models the fold measures.
        advance: Called after each model, of `models_fitted` at most.
    """
    if pairs.num_preferences == 0:
        return no_reward(pairs, cfg)
    started_s = time.perf_counter()
    prepared = prepare(pairs, cfg)
    kind, considered = cfg.kind, ()
    if kind == "auto":
        kind, considered = choose(prepared, pairs, cfg, seed, measured, advance)
    linear = members_for(cfg.linear, len(pairs))
    cfg = replace(cfg, kind=kind, linear=linear)
    judged, cfg = _settled(prepared, pairs, cfg)
    answers, doubted = judged.prepared.seen_by(KINDS[kind].sight), 0
    if cfg.label_filter is not None:
        answers, doubted = without_doubted(answers, cfg, seed=seed)
    others = _described(unanswered, cfg)
    normaliser, scorer = fit_ensemble(answers, cfg, seed, others)
    advance()
    if (share := scorer.error_share_found) is not None:
        cfg = replace(cfg, error_share=share)
    held_out = torch.zeros(len(pairs), dtype=torch.bool)
    foreseen = Prediction.none(0)
    if measured:
        held_out, foreseen = held_out_predictions(
            answers, pairs.episodes, cfg, seed, others, advance=advance
        )
        foreseen = foreseen.subset(judged.measuring[held_out])
        held_out &= judged.measuring
    measured_by = answers
    if scorer.error_share_found is not None and not judged.raters:
        errors = errors_alike(answers, cfg, cfg.error_share)
        measured_by = answers.with_errors(errors)
    report = report_of(
        measured_by.described,
        leads_by(scorer.payer, answers.described, normaliser).mean(dim=0),
        held_out,
        foreseen,
        cfg,
        time.perf_counter() - started_s,
        at_random=pairs.at_random,
        fold=folds_of(pairs.episodes, cfg)[:, 0],
        without_target=pairs.num_without_target,
    )
    report = replace(
        report, raters=judged.raters, doubted=doubted, considered=considered
    )
    model = RewardModel(normaliser, scorer, _made_from(pairs, cfg, report))
    model.calibrate(answers.described)
    if measured:
        report = _with_remaining(model, pairs)
    logger.info("fitted a %s reward: %s", kind, report)
    return model, report


def models_fitted(cfg: FitCfg) -> int:
    """How many models a measured fit is made of: the reward, and one for each fold that
    measures it, or chooses its kind."""
    chosen_from = len(CHOSEN_FROM) if cfg.kind == "auto" else 0
    return 1 + cfg.folds * (1 + chosen_from)


def no_reward(pairs: AnsweredPairs, cfg: FitCfg) -> tuple[RewardModel, FitReport]:
    """A reward that is 0 everywhere, and says of which answers: they prefer nothing, or
    too little."""
    started_s = time.perf_counter()
    kind = cfg.kind if cfg.kind in KINDS else get_args(KindName)[0]
    cfg = replace(cfg, kind=kind, linear=members_for(cfg.linear, len(pairs)))
    prepared = prepare(pairs, cfg)
    report = report_of(
        prepared.described,
        torch.zeros(len(pairs)),
        torch.zeros(len(pairs), dtype=torch.bool),
        Prediction.none(0),
        cfg,
        time.perf_counter() - started_s,
        at_random=pairs.at_random,
        fold=folds_of(pairs.episodes, cfg)[:, 0],
        without_target=pairs.num_without_target,
    )
    provenance = _made_from(pairs, cfg, report)
    model = RewardModel(prepared.clips.normaliser, make_scorer(cfg), provenance)
    return model, _with_remaining(model, pairs)


def _made_from(pairs: AnsweredPairs, cfg: FitCfg, report: FitReport) -> Provenance:
    seen = frozenset(sha256 for pair in pairs.episodes for sha256 in pair)
    return Provenance(cfg, report, pairs.answers_sha256, seen)


def _with_remaining(model: RewardModel, pairs: AnsweredPairs) -> FitReport:
    """The report of `model`, which keeps it, with what there is left to ask."""
    left, report = remaining(model, pairs), model.provenance.report
    report = replace(
        report,
        agreement=left.agreement,
        open_share=left.open_share,
        enough=enough(left, report),
    )
    model.provenance = replace(model.provenance, report=report)
    return report


def _settled(
    prepared: Prepared, pairs: AnsweredPairs, cfg: FitCfg
) -> tuple[Judged, FitCfg]:
    """Answers with the errors of their raters, and `cfg` with what they decide put in,
    where it leaves that to them."""
    kind = kind_called(cfg.kind)
    if kind.pooled or not cfg.adapt:
        return judge(prepared, pairs, cfg), cfg
    seen = prepared.seen_by(kind.sight)
    found = settled(cfg, noise_level(seen, cfg), tells_errors=kind.tells_errors)
    errors = errors_alike(prepared, found, found.error_share)
    judged = judge(prepared.with_errors(errors), pairs, found)
    if not judged.measuring.all():
        # How strong opinions may be is for those to say who look.
        level = noise_level(seen.subset(judged.measuring), cfg)
        found = settled(cfg, level, tells_errors=kind.tells_errors)
    return judged, found


def _described(pairs: AnsweredPairs | None, cfg: FitCfg) -> Unanswered | None:
    if pairs is None or cfg.semi_supervised is None:
        return None
    return Unanswered(prepare(pairs, cfg).described, folds_of(pairs.episodes, cfg))


def report_of(
    fitted: ClipPairs,
    lead: Tensor,
    asked: Tensor,
    foreseen: Prediction,
    cfg: FitCfg,
    seconds: float,
    *,
    at_random: Tensor,
    fold: Tensor,
    without_target: int = 0,
) -> FitReport:
    """What there is to say of a fit.

    Args:
        fitted: The answers.
        lead: [B] what the reward says of them.
        asked: [B] bool, those foreseen by models that have seen neither segment.
        foreseen: What these say.
        cfg: How it was fitted.
        seconds: How long that took.
        at_random: [B] bool, those no reward chose for being hard.
        fold: [B] in which each was foreseen.
        without_target: Answers left out.
    """
    right, preferences = _count_right(fitted.target, lead)
    held_out, at_random = fitted.subset(asked), at_random[asked]
    counts = counting(at_random, held_out.target, erring=takes_to_err(cfg))
    told = (foreseen.logit, held_out.target, counts)
    temperature = fit_temperature(*told, error_share=cfg.error_share)
    cooled = cooled_apart(*told, fold[asked], error_share=cfg.error_share)
    found = calibration(cooled, held_out.target, counts)
    drawn_right, drawn = _count_right(
        held_out.target[at_random], foreseen.lead[at_random]
    )
    held_out_right, held_out_preferences = _count_right(held_out.target, foreseen.lead)
    return FitReport(
        answers=len(fitted),
        answers_without_target=without_target,
        ties=len(fitted) - preferences,
        train_accuracy=_share(right, preferences),
        train_log_likelihood=fitted.log_likelihood(lead, cfg).mean().item(),
        held_out_pairs=held_out_preferences,
        held_out_accuracy=_share(held_out_right, held_out_preferences),
        held_out_interval=(
            wilson_interval(held_out_right, held_out_preferences)
            if held_out_preferences
            else None
        ),
        at_random_pairs=drawn,
        at_random_accuracy=_share(drawn_right, drawn),
        held_out_log_likelihood=(
            held_out.log_likelihood(foreseen.lead, cfg).mean().item()
            if len(held_out)
            else None
        ),
        temperature=temperature,
        held_out_ece=found.ece if found else None,
        held_out_brier=found.brier if found else None,
        seconds=seconds,
    )


def _count_right(target: Tensor, lead: Tensor) -> tuple[int, int]:
    """How many preferences a lead [B] foresees, and how many there are."""
    preference = target != 0.5
    right = ((lead > 0) == (target > 0.5)) & preference & (lead != 0)
    # Who has no lead guesses, and is right half of the time.
    guessed = int((preference & (lead == 0)).sum()) // 2
    return int(right.sum()) + guessed, int(preference.sum())


def _share(right: int, total: int) -> float | None:
    return right / total if total else None
