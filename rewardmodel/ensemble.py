"""One fit to described answers: what standardises them, and what scores them.

Shapes: B pairs.
"""

from __future__ import annotations

from typing import get_args

import torch

from .cfg import FitCfg, Kind
from .gp import fit_gp
from .history import fit_history
from .linear import fit_linear
from .mlp import fit_mlp
from .model import Scorer, leads_of_pairs
from .normaliser import Normaliser
from .semi_supervised import Unanswered, with_opinions
from .sparse_fit import fit_sparse
from .training import TrainingPairs
from .transformer import fit_transformer


def fit_ensemble(
    pairs: TrainingPairs, cfg: FitCfg, seed: int, others: Unanswered | None = None
) -> tuple[Normaliser, Scorer]:
    """Normaliser and ensemble for described `pairs`; with `others`, once more with what
    the first is sure of in them.

    Raises:
        ValueError: `cfg` names no model, or leaves open which.
    """
    normaliser, scorer = _fit_once(pairs, cfg, seed)
    if others is None or len(others.pairs) == 0:
        return normaliser, scorer
    leads = leads_of_pairs(scorer, others.pairs.transformed(normaliser))
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
        case "linear":
            scorer = fit_linear(standardised, cfg, generator=generator)
        case _:
            raise ValueError(
                f"`{cfg.kind}` is no model: one of {', '.join(get_args(Kind))} is, and "
                "which of them `auto` stands for is chosen before a fit"
            )
    return normaliser, scorer
