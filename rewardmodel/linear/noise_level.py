"""How strong opinions may be, and how often raters err: what the answers speak for.

With few answers, or raters who contradict themselves, weights had better stay small;
with many that agree, a prior that holds them back only bends the reward. Both settings
are taken where the evidence for them is largest, as Laplace's approximation gives it
(MacKay 1992, "Bayesian Interpolation", eq. 2.5 ff.).

Shapes: B pairs, D descriptors.
"""

from __future__ import annotations

import math
from collections.abc import Sized
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from rewardmodel.answers.likelihood import Errors
from rewardmodel.cfg import FitCfg
from rewardmodel.prepared.described import ClipPairs
from rewardmodel.prepared.prepared import Prepared

from .laplace import evidence
from .linear import expected_weights

PRECISIONS = (0.03, 0.1, 0.3, 1.0, 3.0)
ERROR_SHARES = (0.02, 0.1, 0.2, 0.3, 0.5, 0.7)
"""What is tried."""
FEW_ERRORS = 0.1
"""Share of random answers up to which they can be overlooked."""
_SURE = 1.0
"""Logarithm of the odds from which on answers are taken to err."""
_ERRING_SHARE, _ERRING_TIE = 0.3, 0.3
"""Where answers err, the least share of them that is taken to be random, and the lead,
in logits, from which on the others are meant."""
PLENTY = 1000
"""Answers from which on every second, third, ... is looked at: two settings are known
well enough from them."""
_PRECISION_SPREAD, _ERROR_SPREAD = 0.75, 1.0
"""Deviations, of the logarithm and of the logit, of what is expected beforehand around
the settings: a handful of answers leaves both about where they were."""
_ERRING_TIMES, _ERRING_SPREAD = 3.0, 0.4
"""How much weaker opinions are expected to be where answers err, and how surely."""


def takes_to_err(cfg: FitCfg) -> bool:
    """Whether more answers are random than can be overlooked: as was decided, else as
    the share that `cfg` expects says."""
    if cfg.answers_err is not None:
        return cfg.answers_err
    return cfg.error_share > FEW_ERRORS


@dataclass(frozen=True)
class Found:
    """What the answers speak for, as far as a linear reward can tell."""

    error_share: float
    prior_precision: float
    tie_threshold: float


def noise_level(prepared: Prepared, cfg: FitCfg) -> Found:
    """The settings with the largest evidence, for the answers of `prepared`.

    Answers are wrong at random, whatever is asked, or where pairs are close, and which
    of the two it is a hundred of them hardly say; taken for the other kind, either
    teaches what nobody wants. So where they err, both are expected.
    """
    some = torch.arange(len(prepared)) % -(-len(prepared) // PLENTY) == 0
    tried = _tried(prepared.subset(some), cfg)
    weak = _ERRING_TIMES * cfg.linear.prior_precision
    weakly = _weighed(tried, weak, _ERRING_SPREAD)
    found, err = _best(weakly, cfg), cfg.answers_err
    if err is None:
        err = found.error_share > FEW_ERRORS and _for_errors(weakly) > _SURE
    if not err:
        # Only where answers agree to who hardly has opinions may they be strong ones:
        # any answers agree to those. And what weights cannot say, strong opinions take
        # for errors: these are few where the odds did not speak for more.
        few = {key: height for key, height in tried.items() if key[0] <= FEW_ERRORS}
        strongly = _weighed(few, cfg.linear.prior_precision, _PRECISION_SPREAD)
        return _best(strongly, cfg)
    share = max(found.error_share, _ERRING_SHARE)
    return Found(share, weak, min(cfg.tie_threshold, _ERRING_TIE))


Tried = dict[tuple[float, float], float]
"""Logarithm of how well a share of random answers and a precision explain answers."""


def _tried(prepared: Prepared, cfg: FitCfg) -> Tried:
    """The evidence of the answers for all that is tried."""
    seen = prepared.seen_by("habits")
    pairs, inputs = seen.described, seen.clips.differences.inputs
    mean = expected_of_all(seen, cfg)
    return {
        (share, precision): evidence(
            inputs, erring(pairs, cfg, share), cfg, precision, mean=mean
        )
        for precision in PRECISIONS
        for share in ERROR_SHARES
    }


def expected_of_all(prepared: Prepared, cfg: FitCfg) -> Tensor:
    """Weights [D] expected of raters who do not err: of these it is asked whether they
    do."""
    plain = replace(cfg.linear, told_most=False)
    return expected_weights(
        prepared.described, prepared.clips.differences.spread, plain
    )


def _weighed(tried: Tried, precision: float, spread: float) -> Tried:
    """`tried` with what is expected of the precision before any answer, up to a
    constant."""
    return {
        (share, other): height - 0.5 * (math.log(other / precision) / spread) ** 2
        for (share, other), height in tried.items()
    }


def _best(tried: Tried, cfg: FitCfg) -> Found:
    """The most probable, with what is expected of the share."""
    best = max(
        tried, key=lambda each: tried[each] + expected_share(each[0], cfg.error_share)
    )
    return Found(*best, cfg.tie_threshold)


def _for_errors(tried: Tried) -> float:
    """Logarithm of the odds that answers are random more often than hardly ever."""
    hardly = ERROR_SHARES[0]
    never = max(height for (share, _), height in tried.items() if share == hardly)
    others = max(height for (share, _), height in tried.items() if share != hardly)
    return others - never


def settled(cfg: FitCfg, found: Found, *, tells_errors: bool) -> FitCfg:
    """`cfg` with what was found put in, done adapting.

    What a linear reward cannot see looks like an error to it, so a model that sees more
    expects no more errors than it did; fewer, where even the linear one finds fewer.
    """
    cfg = replace(cfg, tie_threshold=found.tie_threshold)
    if not tells_errors:
        share = min(cfg.error_share, found.error_share)
        return replace(cfg, adapt=False, error_share=share)
    linear = replace(cfg.linear, prior_precision=found.prior_precision)
    if found.error_share <= FEW_ERRORS:
        linear = replace(linear, told_most=False)
    return replace(cfg, adapt=False, error_share=found.error_share, linear=linear)


def erring(pairs: ClipPairs, cfg: FitCfg, share: float) -> ClipPairs:
    """`pairs` whose answers are all expected to be random in a share of the cases."""
    return replace(pairs, errors=errors_alike(pairs, cfg, share))


def errors_alike(pairs: Sized, cfg: FitCfg, share: float) -> Errors:
    """Errors of answers that are all random in one share of the cases."""
    return Errors.alike(share, len(pairs), tie_threshold=cfg.tie_threshold)


def expected_share(share: float, centre: float) -> float:
    """Logarithm of how probable a share of random answers is before any answer, beside
    the share at the `centre` of what is expected."""
    centre = min(max(centre, ERROR_SHARES[0]), ERROR_SHARES[-1])
    return -0.5 * ((_logit(share) - _logit(centre)) / _ERROR_SPREAD) ** 2


def _logit(share: float) -> float:
    return math.log(share / (1 - share))
