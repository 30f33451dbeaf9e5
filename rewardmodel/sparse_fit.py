"""How a sum of curves is fitted to answers, and what of it they leave open.

Shapes: M ensemble members, B pairs, C candidates, G curves, W weights of a curve,
P = G W.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import torch
from torch import Tensor

from .cfg import FitCfg, SparseCfg
from .clips import mean_over
from .descriptors import TOLD, names_seen
from .evidence import ERROR_SHARES, erring, evidence, expected_share
from .forward import LEFT_OUT, PRICE, chosen_curves
from .legs import CONTACTS, ENDS, SINGLE
from .linear import MIN_SPREAD
from .normaliser import Normaliser
from .sparse import CENTRES, WEIGHTS, SparseScorer, curves
from .training import TrainingPairs, bootstrap_counts
from .views import Look, View

_SINGLE = tuple(
    index
    for index, name in enumerate(names_seen("legs"))
    if name in {item.name for item in (*CONTACTS, *SINGLE)}
)
_ENDS = tuple(names_seen("legs").index(item.name) for item in ENDS)
_TOLD = tuple(
    index
    for index, name in enumerate(names_seen("legs"))
    if name in (*TOLD, "forward_speed", "leftward_speed", "yaw_rate")
    or name.startswith("foot_speed")
)
"""What a command says. Over a stride the feet go as fast as the robot does."""
_SINGLES_PRICE = 10.0
"""Logarithm of the odds against single legs before any answer: fits of wishes about all
legs alike gained up to 8, of one about one foot 21 from 73 answers."""
_ENDS_PRICE = 5.0
"""The same against front and rear feet apart, a third as many curves: of fits of
other wishes nine in ten gained less, of one about front feet eight in
nine gained more."""
_AT_ONCE = 64
"""Pairs whose steps are looked at together, some 20 MB."""


def fit_sparse(
    pairs: TrainingPairs, cfg: FitCfg, *, generator: torch.Generator
) -> SparseScorer:
    """Fit each member to its own bootstrap of standardised `pairs`."""
    scorer = SparseScorer(cfg.sparse.num_members, pairs.steps.shape[-1])
    scorer.look_at(pairs)
    inputs, units = scaled_curves(scorer, pairs)
    counts = bootstrap_counts(cfg.sparse.num_members, len(pairs), generator=generator)
    theta, _ = relevant(inputs, pairs, counts.double(), cfg)
    scorer.weights.copy_(theta / units)
    return scorer


def scaled_curves(scorer: SparseScorer, pairs: TrainingPairs) -> tuple[Tensor, Tensor]:
    """Differences [B, P] of the clips' curves in float64, and what they are divided by.

    A curve's straight line and its bumps, all together, shift a pair by the usual
    amount for one unit of weight.
    """
    parts = []
    for chosen in torch.arange(len(pairs)).split(_AT_ONCE):
        part = pairs.subset(chosen)
        seen = scorer.seen(part.steps, scored=part.scored, before=part.lift_offs_before)
        values = curves(seen).mT
        left, right = mean_over(values, part.scored[..., None, :])
        parts.append((left - right).double())
    difference = torch.cat(parts)
    squares = difference.square().mean(dim=0).unflatten(0, (-1, WEIGHTS))
    line, bumps = squares[:, :1], squares[:, 1:].sum(dim=1, keepdim=True)
    units = torch.cat([line, bumps.expand(-1, len(CENTRES))], dim=1).sqrt()
    units = units.clamp_min(MIN_SPREAD).flatten()
    return difference / units, units


def standardised_curves(pairs: TrainingPairs) -> tuple[Tensor, TrainingPairs]:
    """What `scaled_curves` gives for raw `pairs`, and these standardised by their own
    steps."""
    normaliser = Normaliser(pairs.steps.shape[-1]).fit(pairs.scored_steps)
    standardised = pairs.transformed(normaliser)
    scorer = SparseScorer(1, pairs.steps.shape[-1])
    scorer.look_at(standardised)
    inputs, _ = scaled_curves(scorer, standardised)
    return inputs, standardised


def relevant(
    inputs: Tensor, pairs: TrainingPairs, counts: Tensor, cfg: FitCfg
) -> tuple[Tensor, Tensor]:
    """Weights [M, P] of the curves that matter, and their variances [M, P].

    Args:
        inputs: [B, P] float64 scaled differences of the clips' curves.
        pairs: Their answers and falls.
        counts: [M, B] float64, how often a member sees an answer.
        cfg: The likelihood of an answer, and which curves may matter.
    """
    curves = inputs.unflatten(1, (-1, WEIGHTS))
    allowed = _allowed(curves, cfg.sparse)
    return chosen_curves(curves, pairs, counts, cfg, allowed=allowed)


def _allowed(curves: Tensor, cfg: SparseCfg) -> Tensor:
    """[C] indices of the curves that may matter, of differences [B, G, W]."""
    allowed = curves.abs().sum(dim=(0, 2)) > 0
    if not cfg.single_legs:
        allowed[list(_SINGLE)] = False
    if not cfg.ends:
        allowed[list(_ENDS)] = False
    if not cfg.told:
        allowed[list(_TOLD)] = False
    return allowed.nonzero()[:, 0]


def find(pairs: TrainingPairs, cfg: FitCfg) -> FitCfg:
    """`cfg` with what described `pairs` speak for put in, done adapting: the share of
    random answers, and whether single legs matter, or front and rear feet apart.

    To weights that cannot say what was wanted, all answers look random; curves that can
    say it tell the raters' errors from their own. Among so many curves of single legs
    some always fit a few answers, so the evidence for them has to be overwhelming.
    """
    inputs, standardised = standardised_curves(pairs.seen_by(cfg))
    tried: dict[tuple[SparseCfg, float], float] = {}
    for sparse in _open_settings(cfg.sparse):
        for share in ERROR_SHARES:
            own = erring(standardised, cfg, share)
            counts = inputs.new_ones(1, len(own))
            settings = replace(cfg, sparse=sparse)
            theta, variance = relevant(inputs, own, counts, settings)
            found = evidence(inputs, own, cfg, 1 / variance[0], start=theta)
            expected = expected_share(share, cfg.error_share)
            tried[sparse, share] = expected + found - _price(sparse)
    sparse, share = max(tried, key=lambda settings: tried[settings])
    return replace(cfg, adapt=False, error_share=share, sparse=sparse)


def looks(
    pairs: TrainingPairs, cfg: FitCfg
) -> tuple[TrainingPairs, dict[SparseCfg, Look]]:
    """Described `pairs` standardised, and how to look at them under each setting that
    `cfg` leaves open."""
    inputs, standardised = standardised_curves(pairs.seen_by(cfg))

    def look_under(sparse: SparseCfg) -> Look:
        settings = replace(cfg, sparse=sparse)

        def look(answered: TrainingPairs) -> View:
            counts = inputs.new_ones(1, len(answered))
            theta, variance = relevant(inputs, answered, counts, settings)
            chosen = variance[0] > LEFT_OUT
            num_curves = int(chosen.sum()) // WEIGHTS
            return View(
                inputs=inputs[:, chosen],
                precision=1 / variance[0, chosen],
                start=theta[:, chosen],
                price=num_curves * PRICE + _price(sparse),
            )

        return look

    return standardised, {s: look_under(s) for s in _open_settings(cfg.sparse)}


def _price(sparse: SparseCfg) -> float:
    singles = _SINGLES_PRICE if sparse.single_legs else 0.0
    return singles + (_ENDS_PRICE if sparse.ends else 0.0)


def _open_settings(cfg: SparseCfg) -> Iterator[SparseCfg]:
    """`cfg` with what it leaves open put in, in every way but both: what ends say,
    single legs can say."""
    both = (False, True)
    for singles, ends in product(
        both if cfg.single_legs is None else (cfg.single_legs,),
        both if cfg.ends is None else (cfg.ends,),
    ):
        if not (cfg.is_open and singles and ends):
            yield replace(cfg, single_legs=singles, ends=ends)
