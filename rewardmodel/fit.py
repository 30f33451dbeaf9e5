"""Fitting a reward to answers, and measuring it on episodes it has not seen.

Shapes: M ensemble members, B pairs.
"""

from __future__ import annotations

import hashlib
import logging
import time
from dataclasses import replace
from typing import get_args

import torch
from torch import Tensor

from .calibration import calibration, fit_temperature
from .caution import FEW_ERRORS
from .cfg import FitCfg as FitCfg
from .cfg import Kind
from .enough import enough, remaining
from .evidence import erring, find, settled
from .gp import fit_gp
from .history import fit_history
from .linear import fit_linear, members_for
from .mlp import fit_mlp
from .model import Provenance, RewardModel, Scorer
from .normaliser import Normaliser
from .pairs import AnsweredPairs
from .reliability import with_reliability
from .report import FitReport as FitReport
from .report import wilson_interval
from .selection import FEW_HELD_OUT, MIN_HELD_OUT, choose_kind
from .semi_supervised import Unanswered, with_opinions
from .sparse import find as look
from .sparse import fit_sparse
from .training import TrainingPairs, training_pairs
from .transformer import fit_transformer

logger = logging.getLogger(__name__)

WELL_FORESEEN = 0.75
"""Held-out preferences that linear weights must foresee, or curves of few habits are
tried: among a hundred weights some always fit a few answers, and few look wrong."""


def fold_of(sha256: str, folds: int = 5) -> int:
    """The group of an episode: the same in every round and on every machine."""
    digest = hashlib.sha256(sha256.encode()).digest()
    return int.from_bytes(digest[:8]) % folds


def fit_reward(
    pairs: AnsweredPairs,
    cfg: FitCfg,
    *,
    seed: int,
    measured: bool = True,
    unanswered: AnsweredPairs | None = None,
) -> tuple[RewardModel, FitReport]:
    """Fit a reward to all answers, and once more without each fold to measure it.

    Where the model is to be chosen, held-out answers choose it; how often answers are
    wrong, and how strong opinions may be, is then found from them, and where several
    raters answered how reliable each is. The reward's own settings name what was found.
    Equal pairs, settings and seed give equal bytes.

    Args:
        pairs: The answers.
        cfg: Which model, and how it is fitted.
        seed: Bootstrap draws and first weights.
        measured: Off, no fold is fitted: the same reward in a fraction of the time,
            for those who only ask where it is in doubt. It is then not calibrated,
            and `auto` takes the stiffest model.
        unanswered: Pairs nobody answered, for `cfg.semi_supervised`. Those with a clip
            in a fold are kept from the models the fold measures.
    """
    started_s = time.perf_counter()
    plain = training_pairs(pairs, cfg)
    kind, considered = _chosen(plain, pairs, cfg, seed, measured)
    cfg = replace(cfg, kind=kind, linear=members_for(cfg.linear, len(pairs)))
    if cfg.adapt:
        sparse = cfg.kind == "sparse"
        cfg = look(plain, cfg) if sparse else settled(cfg, find(plain, cfg))
        plain = erring(plain, cfg, cfg.error_share)
    described, raters = with_reliability(plain, pairs.raters, cfg, seed=seed)
    described = described.seen_by(cfg)
    others = _described(unanswered, cfg)
    normaliser, scorer = _fit(described, cfg, seed, others)
    standardised = described.transformed(normaliser)
    held_out = torch.zeros(len(pairs), dtype=torch.bool)
    held_out_lead = torch.zeros(0)
    if measured:
        held_out, held_out_lead = held_out_leads(
            described, pairs.episodes, cfg, seed, others
        )
    report = _report(
        pairs,
        described,
        standardised.leads(scorer).mean(dim=0),
        described.subset(held_out),
        held_out_lead,
        cfg,
        time.perf_counter() - started_s,
    )
    report = replace(report, raters=raters, considered=considered)
    seen = frozenset(sha256 for pair in pairs.episodes for sha256 in pair)
    provenance = Provenance(cfg, report, pairs.answers_sha256, seen)
    model = RewardModel(normaliser, scorer, provenance)
    model.calibrate(standardised)
    if measured:
        left = remaining(model, pairs)
        report = replace(
            report,
            agreement=left.agreement,
            open_share=left.open_share,
            enough=enough(left, report),
        )
        model.provenance = replace(provenance, report=report)
    logger.info("fitted a %s reward: %s", cfg.kind, report)
    return model, report


def _described(pairs: AnsweredPairs | None, cfg: FitCfg) -> Unanswered | None:
    if pairs is None or cfg.semi_supervised is None:
        return None
    folds = [[fold_of(sha256, cfg.folds) for sha256 in pair] for pair in pairs.episodes]
    return Unanswered(training_pairs(pairs, cfg).seen_by(cfg), torch.tensor(folds))


def _fit(
    pairs: TrainingPairs, cfg: FitCfg, seed: int, others: Unanswered | None = None
) -> tuple[Normaliser, Scorer]:
    """Normaliser and ensemble for described `pairs`; with `others`, once more with what
    the first is sure of in them."""
    normaliser, scorer = _fit_once(pairs, cfg, seed)
    if others is None or len(others.pairs) == 0:
        return normaliser, scorer
    leads = others.pairs.transformed(normaliser).leads(scorer)
    return _fit_once(with_opinions(pairs, others.pairs, leads, cfg), cfg, seed)


def _fit_once(
    pairs: TrainingPairs, cfg: FitCfg, seed: int
) -> tuple[Normaliser, Scorer]:
    """Normaliser and ensemble for described `pairs`, from their own steps alone."""
    generator = torch.Generator().manual_seed(seed)
    normaliser = Normaliser(pairs.steps.shape[-1]).fit(pairs.scored_steps)
    standardised = pairs.transformed(normaliser)
    match cfg.kind:
        case "sparse":
            scorer = fit_sparse(standardised, cfg, generator=generator)
        case "gp":
            scorer = fit_gp(standardised, cfg, generator=generator)
        case "mlp":
            scorer = fit_mlp(standardised, cfg, generator=generator)
        case "history":
            scorer = fit_history(standardised, cfg, generator=generator)
        case "transformer":
            scorer = fit_transformer(standardised, cfg, generator=generator)
        case _:
            scorer = fit_linear(standardised, cfg, generator=generator)
    return normaliser, scorer


def _chosen(
    plain: TrainingPairs,
    pairs: AnsweredPairs,
    cfg: FitCfg,
    seed: int,
    measured: bool,
) -> tuple[Kind, tuple[tuple[str, float], ...]]:
    """A kind of model, and what every kind foresees of held-out answers.

    All expect the same errors here: to a model that finds no sense in the answers, they
    would look random, and it would foresee them as well as chance does.
    """
    if cfg.kind not in ("auto", "grow"):
        return cfg.kind, ()
    stiffest = get_args(Kind)[0]
    if not measured:
        return stiffest, ()
    # Linear weights say most of a walk from few answers; what they cannot say looks
    # like errors to them.
    grows, least = cfg.kind == "grow", MIN_HELD_OUT
    if grows and _weights_will_do(plain, pairs, cfg, seed):
        return stiffest, ()
    if grows and cfg.grows_to == "sparse":
        least = FEW_HELD_OUT
    foreseen: dict[Kind, Tensor] = {}
    described, _ = with_reliability(plain, pairs.raters, cfg, seed=seed)
    for kind in (stiffest, cfg.grows_to) if grows else get_args(Kind):
        # It takes as long as all others together, and where what led to a step does
        # not matter to the simpler of the two, it does not matter.
        if kind == "transformer" and choose_kind(foreseen) != "history":
            break
        own = replace(cfg, kind=kind)
        asked, leads = held_out_leads(described, pairs.episodes, own, seed)
        foreseen[kind] = described.subset(asked).log_likelihood(leads, own)
        if len(foreseen[kind]) < least:
            return kind, ()
    means = tuple((kind, values.mean().item()) for kind, values in foreseen.items())
    errors = 2.0 if grows else 1.0
    return choose_kind(foreseen, errors=errors, least=least), means


def _weights_will_do(
    plain: TrainingPairs, pairs: AnsweredPairs, cfg: FitCfg, seed: int
) -> bool:
    """Whether linear weights say what the answers do: few of them look wrong, and where
    curves of few habits are the alternative, held-out ones are foreseen too."""
    if find(plain, cfg).error_share > FEW_ERRORS:
        return False
    if cfg.grows_to != "sparse":
        return True
    own = replace(cfg, kind="linear")
    asked, leads = held_out_leads(plain, pairs.episodes, own, seed)
    right, preferences = _count_right(plain.target[asked], leads)
    return right >= WELL_FORESEEN * preferences


def held_out_leads(
    pairs: TrainingPairs,
    episodes: tuple[tuple[str, str], ...],
    cfg: FitCfg,
    seed: int,
    others: Unanswered | None = None,
) -> tuple[Tensor, Tensor]:
    """Leads of described pairs by models that have seen neither of their two episodes.

    For every fold, a model is fitted to the pairs with no clip in it and asked about
    the pairs with both clips in it. Grouping by pair instead would let a model meet the
    episodes it is tested on.

    Returns:
        The pairs asked about, [B] bool, and the ensemble's mean lead for each of them.
    """
    folds = torch.tensor(
        [[fold_of(sha256, cfg.folds) for sha256 in pair] for pair in episodes]
    )
    asked = torch.zeros(len(pairs), dtype=torch.bool)
    leads = torch.zeros(len(pairs))
    for fold in range(cfg.folds):
        tested = (folds == fold).all(dim=1)
        fitted = (folds != fold).all(dim=1)
        if tested.any() and fitted.any():
            kept = others.without(fold) if others else None
            leads[tested] = leads_without(pairs, fitted, tested, cfg, seed, kept)
            asked |= tested
    return asked, leads[asked]


def leads_without(
    pairs: TrainingPairs,
    fitted: Tensor,
    tested: Tensor,
    cfg: FitCfg,
    seed: int,
    others: Unanswered | None = None,
) -> Tensor:
    """Mean leads of the pairs in `tested` [B] by a model fitted to those in `fitted`
    [B] alone (bool), and to its opinions on `others`."""
    pairs = pairs.seen_by(cfg)
    if cfg.kind == "sparse" and cfg.sparse.is_open:
        # Held-out answers choose among models; they must not have shaped one of them.
        cfg = replace(cfg, sparse=look(pairs.subset(fitted), cfg).sparse)
    normaliser, scorer = _fit(pairs.subset(fitted), cfg, seed, others)
    return pairs.subset(tested).transformed(normaliser).leads(scorer).mean(dim=0)


def _report(
    answered: AnsweredPairs,
    fitted: TrainingPairs,
    lead: Tensor,
    held_out: TrainingPairs,
    held_out_lead: Tensor,
    cfg: FitCfg,
    seconds: float,
) -> FitReport:
    right, preferences = _count_right(fitted.target, lead)
    temperature = fit_temperature(held_out_lead, held_out.target)
    found = calibration(held_out_lead / temperature, held_out.target)
    held_out_right, held_out_preferences = _count_right(held_out.target, held_out_lead)
    return FitReport(
        answers=len(fitted),
        answers_without_target=answered.num_without_target,
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
        held_out_log_likelihood=(
            held_out.log_likelihood(held_out_lead, cfg).mean().item()
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
    right = ((lead > 0) == (target > 0.5)) & preference
    return int(right.sum()), int(preference.sum())


def _share(right: int, total: int) -> float | None:
    return right / total if total else None
