"""What models foresee of answers about episodes they have not seen.

Shapes: B pairs.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from rewardmodel.cfg import FitCfg
from rewardmodel.extensions.semi_supervised import Unanswered
from rewardmodel.models.ensemble import fit_ensemble
from rewardmodel.models.kinds import kind_called
from rewardmodel.models.model import predict_pairs
from rewardmodel.models.prediction import Prediction
from rewardmodel.prepared.prepared import Prepared


def fold_of(sha256: str, folds: int = 5) -> int:
    """The group of an episode: the same in every round and on every machine."""
    digest = hashlib.sha256(sha256.encode()).digest()
    return int.from_bytes(digest[:8]) % folds


def folds_of(episodes: Sequence[tuple[str, str]], cfg: FitCfg) -> Tensor:
    """[B, 2] groups of the left and the right episode of each pair."""
    folds = [[fold_of(sha256, cfg.folds) for sha256 in pair] for pair in episodes]
    return torch.tensor(folds).reshape(-1, 2)


def held_out_predictions(
    prepared: Prepared,
    episodes: tuple[tuple[str, str], ...],
    cfg: FitCfg,
    seed: int,
    others: Unanswered | None = None,
    *,
    advance: Callable[[], None] = lambda: None,
) -> tuple[Tensor, Prediction]:
    """What models that have seen neither of their two episodes say of prepared pairs.

    For every fold, a model is fitted to the pairs with no clip in it and asked about
    the pairs with both clips in it. Grouping by pair instead would let a model meet the
    episodes it is tested on. `advance` is called after each fold.

    Returns:
        The pairs asked about, [B] bool, and what was foreseen of each of them.
    """
    folds = folds_of(episodes, cfg)
    asked = torch.zeros(len(prepared), dtype=torch.bool)
    found = Prediction.none(len(prepared))
    for fold in range(cfg.folds):
        tested = (folds == fold).all(dim=1)
        fitted = (folds != fold).all(dim=1)
        if tested.any() and fitted.any():
            kept = others.without(fold) if others else None
            found.put(
                tested, prediction_without(prepared, fitted, tested, cfg, seed, kept)
            )
            asked |= tested
        advance()
    return asked, found.subset(asked)


def prediction_without(
    prepared: Prepared,
    fitted: Tensor,
    tested: Tensor,
    cfg: FitCfg,
    seed: int,
    others: Unanswered | None = None,
) -> Prediction:
    """Prediction on the pairs in `tested` [B] by a model fitted to those in `fitted`
    [B] alone (bool), and to its opinions on `others`."""
    seen = prepared.seen_by(kind_called(cfg.kind).sight)
    own = seen.subset(fitted)
    normaliser, scorer = fit_ensemble(own, cfg, seed, others)
    asked = seen.described.subset(tested).standardised(normaliser)
    return predict_pairs(scorer, asked)
