"""What a control step says of a choice: which gait ran where, and what came of it.

As the feature row is what rewards of motion look at, this row is what a reward of
choices looks at: it can be computed again from an episode's file.

Shapes: N environments or steps, O gaits, C columns of a row.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import torch
from torch import Tensor

from data.errors import GaitprefError
from data.features import column
from data.files.plain import ADDED_LATER
from policy.env.course import KINDS

NEAR_M = 0.5
"""An obstacle that is nearer, or that a robot is at, is where it is; else on open
ground."""
PLACES = ("open", *KINDS)
CHANGES, PROGRESS, POWER = "changes_per_s", "progress_m_s", "power_w"


def choice_names(gaits: Sequence[str]) -> tuple[str, ...]:
    """Names of the columns: `walk:open`, ..., and what comes of choices."""
    where = (f"{gait}:{place}" for gait in gaits for place in PLACES)
    return (*where, CHANGES, PROGRESS, POWER)


def choice_rows(
    features: Tensor,
    ahead: Tensor,
    gait: Tensor,
    changed: Tensor,
    moved_m: Tensor,
    *,
    options: int,
    control_dt_s: float,
) -> Tensor:
    """Rows [N, C] of steps.

    Args:
        features: [N, F] after the step.
        ahead: [N, 6] what was ahead before it.
        gait: [N] which gait ran.
        changed: [N] it was another before.
        moved_m: [N] along the course.
        options: How many gaits there are.
        control_dt_s: Time of a step.
    """
    kinds = ahead[:, : len(KINDS)]
    near = (ahead[:, len(KINDS)] <= NEAR_M) & (kinds.sum(dim=1) > 0)
    place = torch.where(near, 1 + kinds.argmax(dim=1), 0)
    cell = gait * len(PLACES) + place
    where = torch.nn.functional.one_hot(cell, options * len(PLACES))
    torque = features[:, column("joint_torque")]
    power_w = (torque * features[:, column("joint_vel")]).abs().sum(dim=1)
    rest = (changed.float() / control_dt_s, moved_m.float() / control_dt_s, power_w)
    return torch.cat((where.float(), torch.stack(rest, dim=1)), dim=1)


@dataclass(frozen=True, kw_only=True)
class ChoiceReward:
    """A reward of choices: weights of the columns of a row and of their squares."""

    told: str
    """What it is, in words."""
    names: tuple[str, ...]
    linear: tuple[float, ...]
    """Per second and unit of the column."""
    square: tuple[float, ...] = ()
    """Of the squares; nothing for none."""
    shift: float = 0.0
    """Added to every second."""
    robot: str = field(default="", metadata=ADDED_LATER)
    """Whose choices it is about; nothing in older files, of which nobody can tell."""
    control_dt_s: float = field(default=0.0, metadata=ADDED_LATER)
    """Time between two of its actions; 0 where `robot` is nothing."""
    model_sha256: str = field(default="", compare=False, metadata=ADDED_LATER)
    """Hash of this robot on its course, which changes nothing of what is paid."""

    def __call__(self, rows: Tensor) -> Tensor:
        """Reward per second [...] of rows [..., C]."""
        score = rows @ torch.tensor(self.linear) + self.shift
        if self.square:
            score = score + rows.square() @ torch.tensor(self.square)
        return score

    def change_cost(self, control_dt_s: float) -> float:
        """What one change takes from a return; less than nothing where it is liked."""
        at = self.names.index(CHANGES)
        spike = 1.0 / control_dt_s
        worth = self.linear[at] * spike
        if self.square:
            worth += self.square[at] * spike**2
        return -worth * control_dt_s


TASK = {PROGRESS: 1.0, POWER: -0.0005, CHANGES: -0.05}
"""What is paid where nobody was asked: metres, less half a millimetre for a joule and
five centimetres for a change."""


def written_reward(
    weights: Mapping[str, float], gaits: Sequence[str], told: str
) -> ChoiceReward:
    """A reward by the names of its columns.

    Raises:
        GaitprefError: there is no such column.
    """
    names = choice_names(gaits)
    if unknown := [name for name in weights if name not in names]:
        raise GaitprefError(
            f"a choice has no column {unknown[0]!r}; there are: {', '.join(names)}"
        )
    linear = tuple(float(weights.get(name, 0.0)) for name in names)
    return ChoiceReward(told=told, names=names, linear=linear)
