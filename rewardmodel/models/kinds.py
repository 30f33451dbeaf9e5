"""The kinds of reward model there are, in one table; `auto` chooses one of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch

from rewardmodel.answers.answered_pairs import AnsweredPairs
from rewardmodel.cfg import FitCfg
from rewardmodel.descriptors.table import Sight, names_seen
from rewardmodel.extensions.models.gp import GpScorer, fit_gp
from rewardmodel.extensions.models.history import WindowScorer, make_history
from rewardmodel.extensions.models.mlp import MlpScorer, fit_mlp
from rewardmodel.extensions.models.raw import RawScorer, fit_raw
from rewardmodel.extensions.models.transformer import make_transformer
from rewardmodel.extensions_cfg import GpCfg, MlpCfg, RawCfg
from rewardmodel.linear.linear import LinearScorer, fit_linear
from rewardmodel.opinions.pool import Pool
from rewardmodel.posterior.curve_scorer import PosteriorScorer
from rewardmodel.posterior.fit_posterior import fit_posterior
from rewardmodel.prepared.described import describe_pairs
from rewardmodel.prepared.prepared import Prepared
from rewardmodel.scorer import Scorer


@dataclass(frozen=True, kw_only=True)
class Kind:
    """What a reward model is made of, and what it says of the answers."""

    sight: Sight
    """What the model sees of a row."""
    make: Callable[[FitCfg, int], Scorer]
    """Makes one without any opinion, for so many descriptors: raw reward 0."""
    fit: Callable[[Prepared, FitCfg, torch.Generator], Scorer]
    """Fits each member to its own bootstrap of the answers."""
    pooled: bool = False
    """Whether its opinions are about all that was recorded, judged or not, and it finds
    by itself how often answers err."""
    tells_errors: bool = False
    """Whether more errors than can be overlooked are the raters', and not what the
    model cannot say."""


def _on_windows(
    make: Callable[[FitCfg, int], WindowScorer],
) -> Callable[[Prepared, FitCfg, torch.Generator], WindowScorer]:
    """How what `make` gives is fitted."""
    return lambda prepared, cfg, generator: make(
        cfg, prepared.standardised.steps.shape[-1]
    ).fit(prepared, cfg, generator)


KINDS: dict[str, Kind] = {
    "linear": Kind(
        sight="habits",
        make=lambda cfg, count: LinearScorer(cfg.linear.num_members, count),
        fit=fit_linear,
        tells_errors=True,
    ),
    "posterior": Kind(
        sight="legs",
        make=lambda cfg, count: PosteriorScorer(
            cfg.posterior.num_particles, cfg.posterior.num_members
        ),
        fit=fit_posterior,
        pooled=True,
    ),
    "gp": Kind(
        sight="habits",
        make=lambda cfg, count: GpScorer(count, cfg.settings_of(GpCfg)),
        fit=fit_gp,
    ),
    "mlp": Kind(
        sight="habits",
        make=lambda cfg, count: MlpScorer(count, cfg.settings_of(MlpCfg)),
        fit=fit_mlp,
    ),
    "history": Kind(
        sight="contacts",
        make=make_history,
        fit=_on_windows(make_history),
    ),
    "transformer": Kind(
        sight="contacts",
        make=make_transformer,
        fit=_on_windows(make_transformer),
    ),
    "raw": Kind(
        sight="rows",
        make=lambda cfg, count: RawScorer(count, cfg.settings_of(RawCfg)),
        fit=fit_raw,
    ),
}
"""From the stiffest to the most flexible."""
EVERYTHING: Sight = "legs"
"""All that any of them sees."""


def kind_called(name: str) -> Kind:
    """The kind of model of that name.

    Raises:
        ValueError: there is none.
    """
    if name not in KINDS:
        raise ValueError(f"no model is called {name!r}; there are {', '.join(KINDS)}")
    return KINDS[name]


def make_scorer(cfg: FitCfg) -> Scorer:
    """An unfitted model of the kind and sizes `cfg` asks for: raw reward 0.

    Raises:
        ValueError: the kind is still to be chosen.
    """
    kind = kind_called(cfg.kind)
    return kind.make(cfg, len(names_seen(kind.sight)))


def prepare(pairs: AnsweredPairs, cfg: FitCfg) -> Prepared:
    """Describe answered pairs, once for the fit, all its folds and kinds of model."""
    known = KINDS.get(cfg.kind)
    if known and not known.pooled:
        return Prepared.of(describe_pairs(pairs, cfg, known.sight))
    return prepare_closely(pairs, cfg)


def prepare_closely(pairs: AnsweredPairs, cfg: FitCfg) -> Prepared:
    """Describe answered pairs for opinions, which are about all there is."""
    pool = Pool.of(pairs, told=cfg.posterior.told)
    return Prepared.of(describe_pairs(pairs, cfg, EVERYTHING), pool)
