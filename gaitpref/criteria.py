"""Criteria: what a simulated rater looks for, and anybody's own.

A criterion is a callable `features [..., F] -> score [...]` on torch tensors, in units
per second, higher is better. It is named, or given as `package.module:function`.

Shapes: F feature columns, T steps, N environments.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import cast

import torch
from torch import Tensor

from data.errors import GaitprefError
from data.features import FEATURE_DIM, column
from policy.reward import TaskRewardCfg, task_score

Criterion = Callable[[Tensor], Tensor]

BUILT_IN = ("task", "smooth", "high_step", "crouch", "low_energy")


class CriterionError(GaitprefError):
    """A criterion cannot be found, or does not do what a criterion must."""


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


def smooth(features: Tensor) -> Tensor:
    """Small changes of the action and no shaking of the trunk, in (0, 1]."""
    jerk = features[..., column("action_rate")].square().sum(dim=-1)
    shaking = features[..., column("base_ang_vel_b")][..., :2].square().sum(dim=-1)
    return 1.0 / (1.0 + jerk + 0.5 * shaking)


def high_step(features: Tensor) -> Tensor:
    """Feet lifted high in their swing: height over 0.15 m, averaged over the feet."""
    lifted = features[..., column("foot_height")].clamp(0.0, 0.15) / 0.15
    swinging = 1.0 - features[..., column("foot_contact")]
    return (lifted * swinging).mean(dim=-1)


def crouch(features: Tensor, *, walking_height_m: float) -> Tensor:
    """A trunk carried at three quarters of its walking height, in (0, 1]."""
    height = features[..., column("base_height")][..., 0]
    return torch.exp(-((height - 0.75 * walking_height_m) / 0.04).square())


def low_energy(features: Tensor) -> Tensor:
    """Little mechanical power, in (0, 1]; 1/2 at 50 W."""
    torque = features[..., column("joint_torque")]
    power_w = (torque * features[..., column("joint_vel")]).abs().sum(dim=-1)
    return 1.0 / (1.0 + power_w / 50.0)


def load_criterion(name: str, context: CriterionContext) -> Criterion:
    """The criterion called `name`, checked on a few rows.

    Args:
        name: One of `BUILT_IN`, or `package.module:function`; the working directory is
            searched too.
        context: The robot's figures, for the built-in ones.

    Raises:
        CriterionError: it cannot be imported, raises, or gives something else than one
            finite number per row.
    """
    built_in: dict[str, Criterion] = {
        "task": partial(
            task_score,
            cfg=context.task,
            control_dt_s=context.control_dt_s,
        ),
        "smooth": smooth,
        "high_step": high_step,
        "crouch": partial(crouch, walking_height_m=context.walking_height_m),
        "low_energy": low_energy,
    }
    if name in built_in:
        return built_in[name]
    criterion = checked(name, _import(name))
    criterion(_probe_rows(context))
    return criterion


def checked(name: str, criterion: Criterion) -> Criterion:
    """`criterion`, with its answers held to shape and finiteness at every call.

    Raises:
        CriterionError: from the returned callable, naming the criterion.
    """

    def call(features: Tensor) -> Tensor:
        try:
            score = criterion(features)
        except Exception as error:
            raise CriterionError(
                f"criterion {name} raised {type(error).__name__}: "
                f"{' '.join(str(error).split())[:200]}; it is called with a float32 "
                f"tensor features [..., {FEATURE_DIM}]"
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


def _import(name: str) -> Criterion:
    module_name, _, attribute = name.partition(":")
    if not module_name or not attribute:
        raise CriterionError(
            f"there is no criterion {name!r}; take one of {', '.join(BUILT_IN)}, or "
            f"give your own as package.module:function"
        )
    here = str(Path.cwd())
    if here not in sys.path:
        # A console script does not search the directory its user stands in.
        sys.path.append(here)
    try:
        found = getattr(importlib.import_module(module_name), attribute)
    except Exception as error:
        raise CriterionError(
            f"criterion {name} cannot be imported from {here}: "
            f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
        ) from error
    if not callable(found):
        raise CriterionError(
            f"criterion {name} is a {type(found).__name__}, not callable"
        )
    return cast(Criterion, found)


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
