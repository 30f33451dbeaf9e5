"""Criteria: what a simulated rater looks for, and anybody's own.

A criterion is a callable `features [..., F] -> score [...]` on torch tensors, in units
per second, higher is better. It is named, or given as `package.module:function`. One
that needs history, as a frequency does, takes two arguments instead: `features [T, N,
F], starts [T, N] -> score [T, N]`, where `starts` marks the first steps of episodes.

Shapes: F feature columns, T steps, N environments.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor

from data.errors import GaitprefError
from data.features import FEATURE_DIM, column
from policy.env.task_reward import TaskRewardCfg, task_score
from policy.training.ppo import ScoreFn

from .own_code import imported
from .styles import (
    TROT_HZ,
    crouch,
    get_up,
    high_step,
    low_energy,
    pace,
    smooth,
    trot,
    trot_history_steps,
)

RowCriterion = Callable[[Tensor], Tensor]
"""Score [...] of rows [..., F], each for itself."""

BUILT_IN = (
    "task",
    "smooth",
    "high_step",
    "crouch",
    "low_energy",
    "trot",
    "pace",
    "get_up",
)
_HISTORY_STEPS = 50
"""Rows before a row that a criterion of somebody's own may look at while training."""


class CriterionError(GaitprefError):
    """A criterion cannot be found, or does not do what a criterion must."""


@dataclass(frozen=True)
class SequenceCriterion:
    """A criterion that looks back."""

    score: ScoreFn
    history_steps: int
    """How many rows before a row matter to its score."""

    def __call__(self, features: Tensor, starts: Tensor) -> Tensor:
        """Score [T, N] of `features` [T, N, F]."""
        return self.score(features, starts)


Criterion = RowCriterion | SequenceCriterion
"""`gaitpref.training.total_reward.score_of_criterion` makes one form of both."""


@dataclass(frozen=True, kw_only=True)
class CriterionContext:
    """What a built-in criterion needs to know of the robot and its environment."""

    task: TaskRewardCfg
    """The hand-written reward, its height set for the robot."""
    control_dt_s: float

    @property
    def walking_height_m(self) -> float:
        """Height of the base in an ordinary walk."""
        if self.task.height_m is None:
            raise ValueError("task.height_m must be set for the robot")
        return self.task.height_m


def load_criterion(name: str, context: CriterionContext) -> Criterion:
    """The criterion called `name`, checked on a few rows.

    Args:
        name: One of `BUILT_IN`, `trot@HZ`, or `package.module:function`; the working
            directory is searched too.
        context: The robot's figures, for the built-in ones.

    Raises:
        CriterionError: it cannot be imported, raises, or gives something else than one
            finite number per row.
    """
    height_m, dt_s = context.walking_height_m, context.control_dt_s
    built_in: dict[str, RowCriterion] = {
        "task": partial(task_score, cfg=context.task, control_dt_s=dt_s),
        "smooth": smooth,
        "high_step": high_step,
        "crouch": partial(crouch, walking_height_m=height_m),
        "low_energy": low_energy,
        "pace": pace,
        "get_up": partial(get_up, walking_height_m=height_m),
    }
    if name in built_in:
        return built_in[name]
    if name == "trot" or name.startswith("trot@"):
        score = partial(trot, frequency_hz=_frequency_hz(name), control_dt_s=dt_s)
        return SequenceCriterion(score, trot_history_steps(dt_s))
    found = _import(name)
    rows = _probe_rows(context)
    if _looks_back(found):
        sequence = SequenceCriterion(checked(name, found), _HISTORY_STEPS)
        sequence(rows, torch.tensor([[True], [False]]).expand(2, 3))
        return sequence
    criterion = checked(name, found)
    criterion(rows)
    return criterion


def _frequency_hz(name: str) -> float:
    """The frequency in `trot@HZ`."""
    text = name.partition("@")[2]
    try:
        frequency_hz = float(text) if text else TROT_HZ
    except ValueError:
        frequency_hz = 0.0
    if not 0.0 < frequency_hz <= 10.0 or name.endswith("@"):
        raise CriterionError(
            f"criterion {name}: the frequency of a trot is a number of Hz up to 10, as "
            f"in trot@{TROT_HZ}"
        )
    return frequency_hz


def _looks_back(criterion: Callable[..., Tensor]) -> bool:
    """Whether a callable must be given `starts` beside the rows."""
    try:
        parameters = inspect.signature(criterion).parameters.values()
    except (TypeError, ValueError):
        return False
    positional = (
        inspect.Parameter.POSITIONAL_ONLY,
        inspect.Parameter.POSITIONAL_OR_KEYWORD,
    )
    needed = [p for p in parameters if p.kind in positional and p.default is p.empty]
    return len(needed) == 2


def checked(name: str, criterion: Callable[..., Tensor]) -> Callable[..., Tensor]:
    """`criterion`, with its answers held to shape and finiteness at every call.

    Raises:
        CriterionError: from the returned callable, naming the criterion.
    """

    def call(features: Tensor, *starts: Tensor) -> Tensor:
        try:
            score = criterion(features, *starts)
        except Exception as error:
            raise CriterionError(
                f"criterion {name} raised {type(error).__name__}: "
                f"{' '.join(str(error).split())[:200]}; it is called with a float32 "
                f"tensor features [..., {FEATURE_DIM}]{', and starts' * len(starts)}"
            ) from error
        if not isinstance(score, Tensor) or score.shape != features.shape[:-1]:
            got = (
                tuple(score.shape)
                if isinstance(score, Tensor)
                else type(score).__name__
            )
            raise CriterionError(
                f"criterion {name} must give a tensor {tuple(features.shape[:-1])} for "
                f"features {tuple(features.shape)}, got {got}: one score per row"
            )
        if not score.isfinite().all():
            count = int((~score.isfinite()).sum())
            raise CriterionError(
                f"criterion {name} gave NaN or infinity for {count} of {score.numel()} "
                f"rows: a score must be finite"
            )
        return score.to(torch.float32)

    return call


def _import(name: str) -> Callable[..., Tensor]:
    module_name, _, attribute = name.partition(":")
    if not module_name or not attribute:
        raise CriterionError(
            f"there is no criterion {name!r}; take one of {', '.join(BUILT_IN)}, or "
            f"give your own as package.module:function"
        )
    try:
        return imported("criterion", name)
    except GaitprefError as error:
        raise CriterionError(str(error)) from error.__cause__


def _probe_rows(context: CriterionContext) -> Tensor:
    """Rows [2, 3, F] of a standing robot and of two that move."""
    rng = torch.Generator().manual_seed(0)
    rows = 0.1 * torch.randn(2, 3, FEATURE_DIM, generator=rng)
    rows[0] = 0.0
    rows[..., column("gravity_b")] = torch.tensor([0.0, 0.0, -1.0])
    rows[..., column("base_height")] = context.walking_height_m
    rows[..., column("foot_contact")] = 1.0
    rows[..., column("fallen")] = 0.0
    return rows
