"""What a simulated rater says about two clips, given their scores step by step.

Shapes: T steps of a clip.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from data.answers.answer_records import ASPECTS, Aspect, Choice

from .rater_cfg import RaterCfg


@dataclass(frozen=True)
class Standards:
    """What a rater compares with, in units of the criterion; the same all day.

    Fixed once for the pairs asked so far, and never multiplied by a setting again.
    """

    typical_lead: float
    """Median distance between the mean scores of the clips of a pair."""
    dull: float
    """Mean score a clip must exceed to be worth a judgement."""


def standards(
    leads: Sequence[float], scores: Sequence[float], skip: float
) -> Standards:
    """The standards of a rater who skips, given all pairs and clips asked about.

    Args:
        leads: Distance between the mean scores of each pair's clips.
        scores: Mean score of each clip.
        skip: Share of the clips that are dull.
    """
    known = [score for score in scores if not math.isnan(score)]
    dull = float(np.quantile(known, skip)) if skip and known else -math.inf
    sizes = [abs(lead) for lead in leads if not math.isnan(lead)] or [1.0]
    # Where most pairs are exactly equal, the others still have a lead.
    return Standards(float(np.median(sizes) or np.mean(sizes)) or 1.0, dull)


def discounted_mean(scores: np.ndarray, gamma: float) -> float:
    """Mean of scores [T], a step counting gamma times as much as the one after it."""
    weights = gamma ** np.arange(len(scores) - 1, -1, -1, dtype=float)
    return float(weights @ scores / weights.sum())


def better(score_a: float, score_b: float) -> Choice:
    """The better clip; equal where the scores are, up to rounding."""
    if abs(score_a - score_b) <= 1e-6 * max(abs(score_a), abs(score_b), 1e-6):
        return "equal"
    return "a" if score_a > score_b else "b"


def judge(
    scores_a: np.ndarray,
    scores_b: np.ndarray,
    cfg: RaterCfg,
    known: Standards,
    rng: np.random.Generator,
) -> Choice:
    """What a rater says about clips with scores [T] each, of any lengths.

    In the order of B-Pref: a pair of dull clips is skipped; a small lead is noted; the
    recent steps decide, by chance where `cfg.beta` is finite; some answers are turned
    round; and a small lead makes "equal" of whatever came out. Skips and small leads
    look at whole clips, the choice only at what the rater remembers. A criterion that
    needs a feature nobody measured gives NaN: then nobody can tell.
    """
    whole_a, whole_b = float(scores_a.mean()), float(scores_b.mean())
    if math.isnan(whole_a) or math.isnan(whole_b):
        return "skip"
    if max(whole_a, whole_b) <= known.dull:
        return "skip"
    close = abs(whole_a - whole_b) < cfg.equal * known.typical_lead
    recent_a = discounted_mean(scores_a, cfg.gamma)
    recent_b = discounted_mean(scores_b, cfg.gamma)
    choice = better(recent_a, recent_b)
    if math.isfinite(cfg.beta):
        lead = (recent_a - recent_b) / known.typical_lead
        choice = "a" if rng.random() < _sigmoid(cfg.beta * lead) else "b"
    if choice != "equal" and rng.random() < cfg.mistakes:
        choice = "b" if choice == "a" else "a"
    return "equal" if close else choice


def said_why(cfg: RaterCfg, rng: np.random.Generator) -> Aspect | Literal[""]:
    """What a rater says to be the reason of a preference."""
    if cfg.why is None:
        return ""
    if rng.random() < cfg.why_right:
        return cfg.why
    others: list[Aspect] = [aspect for aspect in ASPECTS if aspect != cfg.why]
    return others[int(rng.integers(len(others)))]


def _sigmoid(value: float) -> float:
    return 0.5 * (1.0 + math.tanh(value / 2.0))
