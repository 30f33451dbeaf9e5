"""Which model the evidence speaks for: by held-out answers, never by fitted ones.

Shapes: B held-out answers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from torch import Tensor

from rewardmodel.answers.answered_pairs import AnsweredPairs
from rewardmodel.cfg import CHOSEN_FROM, FitCfg, KindName
from rewardmodel.measures.held_out import held_out_predictions
from rewardmodel.measures.rater_reliability import Judged, judge
from rewardmodel.prepared.described import DescribedPairs
from rewardmodel.prepared.prepared import Prepared

MIN_HELD_OUT = 30
"""Held-out answers below which the stiffest model is taken unseen."""


def choose(
    prepared: Prepared,
    pairs: AnsweredPairs,
    cfg: FitCfg,
    seed: int,
    measured: bool,
    advance: Callable[[], None] = lambda: None,
) -> tuple[KindName, tuple[tuple[str, float], ...]]:
    """A kind of model for prepared answers, and what every kind foresees of held-out
    ones.

    All expect the same errors here: to a model that finds no sense in the answers, they
    would look random, and it would foresee them as well as chance does. `advance` is
    called after each fold of each kind.
    """
    stiffest = CHOSEN_FROM[0]
    if not measured:
        return stiffest, ()
    foreseen: dict[KindName, Tensor] = {}
    judged = judge(prepared, pairs, cfg)
    for kind in CHOSEN_FROM:
        # It takes as long as all others together, and where what led to a step does
        # not matter to the simpler of the two, it does not matter.
        if kind == "transformer" and choose_kind(foreseen) != "history":
            break
        own = replace(cfg, kind=kind)
        held_out, leads = _held_out(judged, pairs, own, seed, advance)
        foreseen[kind] = held_out.log_likelihood(leads, own)
        if len(foreseen[kind]) < MIN_HELD_OUT:
            return kind, ()
    means = tuple((kind, values.mean().item()) for kind, values in foreseen.items())
    return choose_kind(foreseen), means


def _held_out(
    judged: Judged,
    pairs: AnsweredPairs,
    cfg: FitCfg,
    seed: int,
    advance: Callable[[], None],
) -> tuple[DescribedPairs, Tensor]:
    """Held-out answers of raters who look, and what models foresee of them [B]."""
    asked, opinion = held_out_predictions(
        judged.prepared, pairs.episodes, cfg, seed, advance=advance
    )
    told = judged.measuring[asked]
    held_out = judged.prepared.described.subset(asked & judged.measuring)
    return held_out, opinion.lead[told]


def choose_kind(log_likelihoods: Mapping[KindName, Tensor]) -> KindName:
    """The model to take, given the log-likelihood [B] of the same held-out answers by
    kind, from the stiffest to the most flexible.

    A more flexible model must foresee them better than the one taken so far by more
    than a standard error of the difference: a draw goes to the stiffer one.
    """
    kinds = iter(log_likelihoods)
    chosen = next(kinds)
    for kind in kinds:
        if len(log_likelihoods[kind]) < MIN_HELD_OUT:
            break
        gain = log_likelihoods[kind] - log_likelihoods[chosen]
        if gain.mean() > gain.std() / len(gain) ** 0.5:
            chosen = kind
    return chosen
