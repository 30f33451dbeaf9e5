"""A reward of choices, fitted to answers by the fit of tables.

Shapes: T steps, C columns of a choice row.
"""

from __future__ import annotations

from collections.abc import Callable

import torch

from data.datasets.dataset import Dataset
from data.datasets.segments import Segments
from policy.options.choice_row import ChoiceReward
from rewardmodel.answers.used import answers_used
from rewardmodel.errors import RewardError
from rewardmodel.fitting.tables import TableReward, fit_table
from rewardmodel.models.fit_report import FitReport

from .choice_clips import ChoiceClips, asked_about
from .choice_sets import Asked


def fit_choices(
    dataset: Dataset,
    gaits: tuple[str, ...],
    *,
    seed: int,
    rater_id: str | None = None,
    advance: Callable[[], None] = lambda: None,
    asked: Asked | None = None,
) -> tuple[ChoiceReward, FitReport]:
    """The reward that the answers of a data set tell, and how well it foresees them.

    Args:
        dataset: Holds the answers, of which those count that any fit would use.
        gaits: Names of what was chosen among.
        seed: Resampling of the answers.
        rater_id: Whose answers; None is everybody's.
        advance: Called after each model, of `models_fitted(TABLE_FIT)`.
        asked: Which robot on which course they must be about; None takes any.

    Raises:
        GaitprefError: there are too few, or they are about something else.
    """
    used = answers_used([dataset]).rows
    used = [row for row in used if rater_id in (None, row.rater_id)]
    if not used:
        raise RewardError(
            f"{dataset.root} has no answers yet; `gaitpref label --dataset "
            f"{dataset.root}` asks people, --wish a simulated rater"
        )
    clips, told = asked_about(used)
    segments = ChoiceClips(dataset, gaits, asked).segments(clips)
    fitted = fit_table(
        segments, told, "linear", seed=seed, unbounded=True, advance=advance
    )
    return as_reward(fitted, segments, f"{len(told)} answers"), fitted.report


def as_reward(fitted: TableReward, segments: Segments, told: str) -> ChoiceReward:
    """The members' mean as weights of columns and of their squares.

    Its unit is the deviation of the judged clips, and the worst of them is worth 0 a
    second: to fall, after which nothing is paid, is never better than to go on.
    """
    weights = fitted.scorer.linear_weights
    assert weights is not None
    own = weights.mean(dim=0) / fitted.normaliser.std
    count = len(segments.names)
    rows = torch.from_numpy(segments.rows[segments.valid])
    std, mean = torch.std_mean(rows, dim=0, correction=0)
    std = std.clamp_min(1e-6)
    # w u + v u^2 of u = (x - mean) / std, in powers of x.
    square = own[count:] / std.square()
    linear = own[:count] / std - 2 * mean * square
    worth = _worth(rows @ linear + rows.square() @ square, segments)
    unit = float(worth.std().clamp_min(1e-6))
    return ChoiceReward(
        told=told,
        names=segments.names,
        linear=tuple((linear / unit).tolist()),
        square=tuple((square / unit).tolist()),
        shift=-float(worth.min()) / unit,
    )


def _worth(scores: torch.Tensor, segments: Segments) -> torch.Tensor:
    """Mean of the scores of each segment's steps."""
    valid = torch.from_numpy(segments.valid)
    table = torch.zeros(valid.shape)
    table[valid] = scores
    return table.sum(dim=1) / valid.sum(dim=1)
