"""Whether answers say anything: how well chance would explain them.

The questions of a loop are asked where a reward is in doubt, so that it foresees hardly
more of their held-out answers than chance does, however much it has learned from all of
them. What it has learned shows in how well it explains them, beside how well it
explains as many answers that mean nothing (a permutation test: Ojala and Garriga 2010,
"Permutation Tests for Studying Classifier Performance", test 1).

Shapes: B pairs.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from .cfg import FitCfg
from .laplace import evidence
from .noise_level import FEW_ERRORS, erring
from .prepared import Prepared
from .sparse_fit import relevant
from .training import ClipPairs

DRAWS = 39
"""Of random answers: a share of a fortieth can be told from none."""
PLENTY = 200
"""Answers from which on every second, third, ... is looked at."""


def explained_by_chance(
    prepared: Prepared, cfg: FitCfg, *, seed: int, draws: int = DRAWS
) -> float:
    """Share, above 0, of answers turned round at random that a sum of curves explains
    at least as well as the answers of `prepared`.

    Explained by curves of all legs alike, with few answers taken to be wrong: that is
    where answers that mean something are farthest from chance.
    """
    some = torch.arange(len(prepared)) % -(-len(prepared) // PLENTY) == 0
    seen = prepared.subset(some).seen_by("legs")
    inputs = seen.clips.curves.inputs
    plain = replace(cfg.sparse, single_legs=False, ends=False)
    settings = replace(cfg, sparse=plain)
    own = erring(seen.standardised, settings, FEW_ERRORS)
    found = _explained(inputs, own, settings)
    generator = torch.Generator().manual_seed(seed)
    as_well = 1
    for _ in range(draws):
        turned = torch.rand(len(own), generator=generator) < 0.5
        random = torch.where(turned, 1 - own.target, own.target)
        as_well += _explained(inputs, replace(own, target=random), settings) >= found
    return as_well / (draws + 1)


def _explained(inputs: Tensor, pairs: ClipPairs, cfg: FitCfg) -> float:
    """Logarithm of the evidence for the curves that matter to the answers."""
    counts = inputs.new_ones(1, len(pairs))
    theta, variance = relevant(inputs, pairs, counts, cfg)
    return evidence(inputs, pairs, cfg, 1 / variance[0], start=theta)
