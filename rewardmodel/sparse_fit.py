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
from .descriptors import names_seen
from .forward import LEFT_OUT, PRICE, chosen_curves
from .habits import TOLD
from .hypothesis import Explain, Hypothesis
from .laplace import evidence
from .legs import CONTACTS, ENDS, SINGLE
from .noise_level import erring, error_shares, expected_share
from .prepared import Prepared
from .sparse import WEIGHTS, SparseScorer
from .training import ClipPairs, bootstrap_counts

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


def fit_sparse(
    prepared: Prepared, cfg: FitCfg, generator: torch.Generator
) -> SparseScorer:
    """Fit each member to its own bootstrap of the answers."""
    pairs, scaled = prepared.standardised, prepared.clips.curves
    counts = bootstrap_counts(cfg.sparse.num_members, len(pairs), generator=generator)
    theta, _ = relevant(scaled.inputs, pairs, counts.double(), cfg)
    scorer = scaled.ranges.like(cfg.sparse.num_members)
    scorer.weights.copy_(theta / scaled.units)
    return scorer


def relevant(
    inputs: Tensor, pairs: ClipPairs, counts: Tensor, cfg: FitCfg
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


def curve_settings(prepared: Prepared, cfg: FitCfg) -> FitCfg:
    """`cfg` with what the answers speak for put in, done adapting: the share of random
    ones, and whether single legs matter, or front and rear feet apart.

    To weights that cannot say what was wanted, all answers look random; curves that can
    say it tell the raters' errors from their own. Among so many curves of single legs
    some always fit a few answers, so the evidence for them has to be overwhelming.
    """
    seen = prepared.seen_by("legs")
    pairs, inputs = seen.standardised, seen.clips.curves.inputs
    tried: dict[tuple[SparseCfg, float], float] = {}
    for sparse in _open_settings(cfg.sparse):
        for share in error_shares(cfg):
            own = erring(pairs, cfg, share)
            counts = inputs.new_ones(1, len(own))
            settings = replace(cfg, sparse=sparse)
            theta, variance = relevant(inputs, own, counts, settings)
            found = evidence(inputs, own, cfg, 1 / variance[0], start=theta)
            expected = expected_share(share, cfg.error_share)
            tried[sparse, share] = expected + found - _price(sparse)
    sparse, share = max(tried, key=lambda settings: tried[settings])
    return replace(cfg, adapt=False, error_share=share, sparse=sparse)


def curve_hypotheses(prepared: Prepared, cfg: FitCfg) -> dict[SparseCfg, Explain]:
    """How to explain answers under each setting that `cfg` leaves open."""
    inputs = prepared.clips.curves.inputs

    def under(sparse: SparseCfg) -> Explain:
        settings = replace(cfg, sparse=sparse)

        def explain(answered: ClipPairs) -> Hypothesis:
            counts = inputs.new_ones(1, len(answered))
            theta, variance = relevant(inputs, answered, counts, settings)
            chosen = variance[0] > LEFT_OUT
            num_curves = int(chosen.sum()) // WEIGHTS
            return Hypothesis(
                inputs=inputs[:, chosen],
                precision=1 / variance[0, chosen],
                start=theta[:, chosen],
                price=num_curves * PRICE + _price(sparse),
            )

        return explain

    return {s: under(s) for s in _open_settings(cfg.sparse)}


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
