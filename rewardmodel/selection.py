"""Which model the evidence speaks for: by held-out answers, never by fitted ones.

Shapes: B held-out answers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import get_args

import torch
from torch import Tensor

from .cfg import FitCfg, Kind
from .evidence import FEW_ERRORS, Found, erring, find, settled
from .held_out import held_out_opinions
from .pairs import AnsweredPairs
from .reliability import Judged, judge
from .training import TrainingPairs

MIN_HELD_OUT = 30
"""Held-out answers below which the stiffest model is taken unseen."""


def choose(
    plain: TrainingPairs,
    pairs: AnsweredPairs,
    cfg: FitCfg,
    seed: int,
    measured: bool,
) -> tuple[Kind, tuple[tuple[str, float], ...]]:
    """A kind of model for described `plain` pairs, where `cfg` leaves it open, and what
    every kind foresees of held-out answers.

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
    grows = cfg.kind == "grow"
    if grows:
        found = find(plain, cfg)
        if found.error_share <= FEW_ERRORS or _says_something(
            plain, pairs, cfg, found, seed
        ):
            return stiffest, ()
    foreseen: dict[Kind, Tensor] = {}
    judged = judge(plain, pairs.raters, cfg)
    for kind in (stiffest, "gp") if grows else get_args(Kind):
        # It takes as long as all others together, and where what led to a step does
        # not matter to the simpler of the two, it does not matter.
        if kind == "transformer" and choose_kind(foreseen) != "history":
            break
        own = replace(cfg, kind=kind)
        held_out, leads = _held_out(judged, pairs, own, seed)
        foreseen[kind] = held_out.log_likelihood(leads, own)
        if len(foreseen[kind]) < MIN_HELD_OUT:
            return kind, ()
    means = tuple((kind, values.mean().item()) for kind, values in foreseen.items())
    errors = 2.0 if grows else 1.0
    return choose_kind(foreseen, errors=errors), means


def _says_something(
    plain: TrainingPairs, pairs: AnsweredPairs, cfg: FitCfg, found: Found, seed: int
) -> bool:
    """Whether weights, with the errors that were found, surely foresee held-out answers
    better than who finds no sense in them: then errors are what they miss."""
    own = settled(replace(cfg, kind="linear"), found)
    expected = erring(plain, own, own.error_share)
    judged = judge(expected, pairs.raters, own)
    held_out, leads = _held_out(judged, pairs, own, seed)
    something = held_out.log_likelihood(leads, own)
    nothing = held_out.log_likelihood(torch.zeros_like(leads), own)
    return len(leads) >= MIN_HELD_OUT and _surely_more(something, nothing, errors=2.0)


def _held_out(
    judged: Judged, pairs: AnsweredPairs, cfg: FitCfg, seed: int
) -> tuple[TrainingPairs, Tensor]:
    """Held-out answers of raters who look, and what models foresee of them [B]."""
    asked, opinion = held_out_opinions(judged.pairs, pairs.episodes, cfg, seed)
    told = judged.measuring[asked]
    return judged.pairs.subset(asked & judged.measuring), opinion.lead[told]


def choose_kind(
    log_likelihoods: Mapping[Kind, Tensor],
    *,
    errors: float = 1.0,
) -> Kind:
    """The model to take, given the log-likelihood [B] of the same held-out answers.

    A more flexible model must foresee them better than the one taken so far by more
    than `errors` standard errors of the difference: a draw goes to the stiffer one.

    Args:
        log_likelihoods: By kind, from the stiffest to the most flexible.
        errors: How sure one wants to be.
    """
    kinds = iter(log_likelihoods)
    chosen = next(kinds)
    for kind in kinds:
        if len(log_likelihoods[kind]) < MIN_HELD_OUT:
            break
        if _surely_more(log_likelihoods[kind], log_likelihoods[chosen], errors=errors):
            chosen = kind
    return chosen


def _surely_more(these: Tensor, those: Tensor, *, errors: float) -> bool:
    """Whether `these` [B] are more than `those` by `errors` standard errors."""
    gain = these - those
    return bool(gain.mean() > errors * gain.std() / len(gain) ** 0.5)
