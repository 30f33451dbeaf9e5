"""One fit to prepared answers: what standardises clips, and what scores them."""

from __future__ import annotations

import torch

from rewardmodel.cfg import FitCfg
from rewardmodel.descriptors.normaliser import Normaliser
from rewardmodel.extensions.semi_supervised import Unanswered, with_opinions
from rewardmodel.prepared.prepared import Prepared
from rewardmodel.scorer import Scorer

from .kinds import kind_called
from .model import leads_of_pairs


def fit_ensemble(
    prepared: Prepared, cfg: FitCfg, seed: int, others: Unanswered | None = None
) -> tuple[Normaliser, Scorer]:
    """Normaliser and ensemble for answers as the kind of `cfg` sees them; with
    `others`, once more with what the first is sure of in them.

    Raises:
        ValueError: `cfg` names no model, or leaves open which.
    """
    normaliser, scorer = _fit_once(prepared, cfg, seed)
    if others is None or len(others.pairs) == 0:
        return normaliser, scorer
    leads = leads_of_pairs(scorer, others.pairs.standardised(normaliser))
    more = with_opinions(prepared.described, others.pairs, leads, cfg)
    return _fit_once(Prepared.of(more, prepared.clips.pool), cfg, seed)


def _fit_once(prepared: Prepared, cfg: FitCfg, seed: int) -> tuple[Normaliser, Scorer]:
    """Normaliser and ensemble for the answers, from their own steps alone."""
    generator = torch.Generator().manual_seed(seed)
    scorer = kind_called(cfg.kind).fit(prepared, cfg, generator)
    return prepared.clips.normaliser, scorer
