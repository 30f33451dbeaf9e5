"""A reward of choices, fitted to answers by the fit of tables.

Shapes: T steps, C columns of a choice row.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch

from data.answers.answer_records import Answer, Pair
from data.datasets.dataset import Dataset
from data.datasets.segments import Segments
from policy.options.choice_row import ChoiceReward
from rewardmodel.errors import RewardError
from rewardmodel.fitting.tables import TableReward, fit_table
from rewardmodel.models.fit_report import FitReport

from .choice_clips import ChoiceClips, answered


def fit_choices(
    dataset: Dataset, gaits: tuple[str, ...], *, seed: int
) -> tuple[ChoiceReward, FitReport]:
    """The reward that the answers of a data set tell, and how well it foresees them.

    Raises:
        GaitprefError: there are too few, or they are about something else.
    """
    with dataset.answers() as store:
        answers = store.current_answers()
    return fit_answers(dataset, answers, gaits, seed=seed)


def fit_answers(
    dataset: Dataset,
    answers: Sequence[tuple[Pair, Answer]],
    gaits: tuple[str, ...],
    *,
    seed: int,
) -> tuple[ChoiceReward, FitReport]:
    """`fit_choices` of some answers."""
    clips, told = answered(answers)
    if not told:
        raise RewardError(
            f"{dataset.root} has no answers yet; `gaitpref label --dataset "
            f"{dataset.root}` asks people, --wish a simulated rater"
        )
    segments = ChoiceClips(dataset, gaits).segments(clips)
    fitted = fit_table(segments, told, "linear", seed=seed)
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
