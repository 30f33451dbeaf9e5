"""A reward for segments of anything: rows of named numbers in place of a robot's.

Each column and its square, standardised, is what a reward sees of a step. Nothing is
expected of any of them before the answers.

Shapes: B answers, S segments, T steps, F columns, D = 2 F descriptors, M members.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np
import torch
from torch import Tensor

from data.answers.answer_records import MIN_ANSWERS
from data.datasets.segments import Segments, TableAnswer
from rewardmodel.answers.clip_batch import mean_over
from rewardmodel.answers.likelihood import Errors
from rewardmodel.cfg import FitCfg, LinearCfg
from rewardmodel.descriptors.normaliser import Normaliser
from rewardmodel.errors import RewardError
from rewardmodel.linear.noise_level import errors_alike, noise_level, settled
from rewardmodel.measures.held_out import folds_of, held_out_predictions
from rewardmodel.models.ensemble import fit_ensemble
from rewardmodel.models.fit_report import FitReport
from rewardmodel.models.kinds import kind_called
from rewardmodel.models.model import leads_by
from rewardmodel.models.prediction import Prediction
from rewardmodel.prepared.described import DescribedPairs
from rewardmodel.prepared.prepared import Prepared, PreparedClips
from rewardmodel.scorer import Scorer

from .fit_reward import report_of
from .stopping import enough, order_left

TableKind = Literal["linear", "gp", "mlp"]
TABLE_KINDS: tuple[TableKind, ...] = get_args(TableKind)
"""Models that see a step, whatever it is of."""
TABLE_FIT = FitCfg(linear=LinearCfg(unsteady_logit=0.0), fall_logit=0.0)
"""How segments are fitted."""
_SHARES = (0.02, 0.1, 0.2, 0.3, 0.5, 0.7, 0.95)
"""Of random answers that a rater may have, each as probable."""
_MOST_BYTES = 4 * 2**30
"""What the steps of all answers may take in memory."""
_MOST_ORDERED = 500
"""Segments whose order says whether more answers would help, of more as many."""
_LEAST_FORESEEN = 10
"""Preferences of a rater, foreseen by models, below which nothing is said of errors."""


class PreparedTable(Prepared):
    """Every model sees all of it."""

    def seen_by(self, sight: str) -> PreparedTable:
        return self


class _Unbounded(PreparedClips):
    """Standardised, and no column clamped."""

    @cached_property
    def normaliser(self) -> Normaliser:
        steps = self._described.steps
        unfitted = Normaliser(steps.shape[-1], most=math.inf)
        return unfitted.fit(steps, self._described.scored)


class PreparedSums(PreparedTable):
    """For a reward that is written down as weights of columns: what is rare, and far
    from the mean where it is, counts as it is."""

    @classmethod
    def of(cls, described: DescribedPairs, pool: None = None) -> PreparedSums:  # pyright: ignore[reportIncompatibleMethodOverride]
        return cls(described, _Unbounded(described))


@dataclass(frozen=True, eq=False)
class TableReward:
    """A reward for segments, and how well it foresees answers."""

    names: tuple[str, ...]
    """[D] of what it sees of a step."""
    normaliser: Normaliser
    scorer: Scorer
    cfg: FitCfg
    report: FitReport

    def worth(self, segments: Segments) -> tuple[Tensor, Tensor]:
        """Mean reward [S] of segments in logits, and its deviation over members."""
        of_members = self.of_members(segments)
        return of_members.mean(dim=0), of_members.std(dim=0)

    def of_members(self, segments: Segments) -> Tensor:
        """Mean reward [M, S] of segments in logits."""
        steps, scored = described(segments)
        rewards = self.scorer.of_clips(self.normaliser(steps), scored, None)
        return mean_over(rewards, scored)


def described(segments: Segments) -> tuple[Tensor, Tensor]:
    """Descriptors [S, T, D] of segments, and which steps there are, [S, T] bool."""
    rows = torch.from_numpy(segments.rows).nan_to_num()
    scored = torch.from_numpy(segments.valid)
    # What is far from 0, as a time of day or a place on a map, differs by little of it.
    rows -= rows[scored].mean(dim=0)
    usual = (rows / rows[scored].std(dim=0, correction=0).clamp_min(1e-6)).float()
    return torch.cat([usual, usual.square()], dim=-1) * scored[..., None], scored


def fit_table(
    segments: Segments,
    answers: Sequence[TableAnswer],
    kind: TableKind,
    *,
    seed: int,
    unbounded: bool = False,
    advance: Callable[[], None] = lambda: None,
) -> TableReward:
    """Fit a reward to answers about segments, and measure it on segments that a model
    has not seen.

    Args:
        segments: What was judged.
        answers: In any order.
        kind: Which model.
        seed: Bootstrap draws and first weights.
        unbounded: Clamp no column, as a sum that is written down has no clamp.
        advance: Called after each model, of `models_fitted(TABLE_FIT)`.

    Raises:
        RewardError: too few answers prefer a segment, or all of them take too much
            memory.
    """
    preferences = sum(answer.target != 0.5 for answer in answers)
    if preferences < MIN_ANSWERS:
        raise RewardError(
            f"{preferences} of {len(answers)} answers prefer a segment; a fit needs at "
            f"least {MIN_ANSWERS}"
        )
    _require_room(segments, len(answers))
    cfg = replace(TABLE_FIT, kind=kind)
    prepared = (PreparedSums if unbounded else PreparedTable).of(
        _pairs(segments, answers, cfg)
    )
    names = tuple((segments.ids[a.left], segments.ids[a.right]) for a in answers)
    fitted = fit_measured(prepared, names, cfg, seed=seed, advance=advance)
    asked, foreseen, report = fitted.asked, fitted.foreseen, fitted.report
    kept = [answer for answer, was in zip(answers, asked.tolist(), strict=True) if was]
    report = replace(report, raters=_raters(kept, foreseen, report.temperature))
    names = (*segments.names, *(f"{name} squared" for name in segments.names))
    reward = TableReward(names, fitted.normaliser, fitted.scorer, fitted.cfg, report)
    return replace(reward, report=_with_remaining(reward, segments))


def _with_remaining(reward: TableReward, segments: Segments) -> FitReport:
    """The report of `reward` with what there is left to ask about segments."""
    count = len(segments.ids)
    chosen = np.linspace(0, count - 1, min(count, _MOST_ORDERED)).astype(int)
    ids = tuple(segments.ids[place] for place in chosen)
    returns = reward.of_members(Segments(ids, segments.names, segments.rows[chosen]))
    left = order_left(returns, returns)
    return replace(
        reward.report,
        agreement=left.agreement,
        open_share=left.open_share,
        enough=enough(left, reward.report),
    )


@dataclass(frozen=True, eq=False)
class Fitted:
    """A reward, and what those said that had not seen what they were asked about."""

    normaliser: Normaliser
    scorer: Scorer
    cfg: FitCfg
    """With what the answers decided put in."""
    report: FitReport
    asked: Tensor
    """[B] bool, answers about what a model had not seen."""
    foreseen: Prediction
    """What was said of these."""


def fit_measured(
    prepared: Prepared,
    names: tuple[tuple[str, str], ...],
    cfg: FitCfg,
    *,
    seed: int,
    at_random: Tensor | None = None,
    advance: Callable[[], None] = lambda: None,
) -> Fitted:
    """Fit a reward to prepared answers and measure it on what models have not seen.

    Args:
        prepared: The answers.
        names: [B] what the left and the right side of each are cut from.
        cfg: How it is fitted.
        seed: Bootstrap draws and first weights.
        at_random: [B] bool, answers about pairs that no reward chose; by default all.
        advance: Called after each model, of `models_fitted`.
    """
    started_s = time.perf_counter()
    found = settled(
        cfg, noise_level(prepared, cfg), tells_errors=kind_called(cfg.kind).tells_errors
    )
    errors = errors_alike(prepared, found, found.error_share)
    prepared = replace(prepared, described=replace(prepared.described, errors=errors))
    normaliser, scorer = fit_ensemble(prepared, found, seed)
    advance()
    asked, foreseen = held_out_predictions(
        prepared, names, found, seed, advance=advance
    )
    report = report_of(
        prepared.described,
        leads_by(scorer.payer, prepared.described, normaliser).mean(dim=0),
        asked,
        foreseen,
        found,
        time.perf_counter() - started_s,
        fold=folds_of(names, cfg)[:, 0],
        at_random=(
            torch.ones(len(prepared), dtype=torch.bool)
            if at_random is None
            else at_random
        ),
    )
    return Fitted(normaliser, scorer, found, report, asked, foreseen)


def _require_room(segments: Segments, answers: int) -> None:
    _, steps, columns = segments.rows.shape
    # Both sides of every answer, each column and its square.
    size = 2 * answers * steps * 2 * columns * 4
    if size > _MOST_BYTES:
        raise RewardError(
            f"{answers:,} answers about segments of up to {steps:,} steps and "
            f"{columns} columns take {size / 2**30:.0f} GB of memory, and "
            f"{_MOST_BYTES / 2**30:.0f} GB are allowed: give shorter segments, fewer "
            "columns, or some of the answers"
        )


def _pairs(
    segments: Segments, answers: Sequence[TableAnswer], cfg: FitCfg
) -> DescribedPairs:
    steps, scored = described(segments)
    sides = torch.tensor([[answer.left, answer.right] for answer in answers]).mT
    count = len(answers)
    return DescribedPairs(
        steps=steps[sides],
        scored=scored[sides],
        fall_lead=torch.zeros(count),
        target=torch.tensor([answer.target for answer in answers]),
        errors=Errors.alike(cfg.error_share, count, tie_threshold=cfg.tie_threshold),
    )


def _raters(
    answers: Sequence[TableAnswer], foreseen: Prediction, temperature: float
) -> tuple[tuple[str, float], ...]:
    """Share of each rater's preferences that is random, as expected after what models
    foresaw of them; of one rater alone, and of who answered too little, nothing."""
    names = sorted({answer.rater for answer in answers})
    if len(names) < 2:
        return ()
    shares = torch.tensor(_SHARES)
    right = (foreseen.logit / temperature).sigmoid()
    found = []
    for name in names:
        own = torch.tensor([a.rater == name and a.target != 0.5 for a in answers])
        if int(own.sum()) < _LEAST_FORESEEN:
            continue
        target = torch.tensor([answer.target for answer in answers])[own]
        likely = torch.where(target > 0.5, right[own], 1 - right[own])
        each = (1 - shares[:, None]) * likely + shares[:, None] / 2
        belief = each.log().sum(dim=1).softmax(dim=0)
        found.append((name, round(float(belief @ shares), 3)))
    return tuple(found)
