"""Descriptors that tell the legs, the sides and the directions apart.

The table of habits sums over the legs and squares signs away, which is what makes
25 weights enough. A wish about one foot, about which feet are down together, or
about which way the trunk leans needs these; only models that pick few of many, or look
back, see them.
"""

from __future__ import annotations

from functools import partial

import torch
from torch import Tensor

from data.answers.answer_records import Aspect
from data.features import LEGS

from .row import Descriptor, Row

_CLEAR_M = 0.08
"""Height of a foot at which 63 % of its clearance is reached."""


def _of_leg(row: Row, *, name: str, leg: int) -> Tensor:
    return row[name][..., leg]


def _column(row: Row, *, name: str, index: int) -> Tensor:
    return row[name][..., index]


def _apart(row: Row, *, first: tuple[int, int]) -> Tensor:
    """How far one pair of feet is down and the other two up, in [0, 1]."""
    contact = row["foot_contact"]
    down = contact[..., list(first)].sum(dim=-1)
    return (2 * down - contact.sum(dim=-1)).abs() / 2


def _clearance(row: Row) -> Tensor:
    return -torch.expm1(-row["foot_height"].clamp_min(0) / _CLEAR_M).mean(dim=-1)


def _of_end(row: Row, *, name: str, legs: tuple[int, int]) -> Tensor:
    return row[name][..., list(legs)].mean(dim=-1)


def _each_end(
    name: str, feature: str, unit: str, meaning: str, aspect: Aspect, concept: str
):
    return tuple(
        Descriptor(
            f"{name}_{end}",
            unit,
            meaning,
            partial(_of_end, name=feature, legs=legs),
            group="feet",
            aspect=aspect,
            concept=concept,
            swings=True,
        )
        for end, legs in (("front", (0, 1)), ("rear", (2, 3)))
    )


def _each_leg(
    name: str,
    feature: str,
    unit: str,
    meaning: str,
    aspect: Aspect,
    *,
    concept: str = "one leg",
    group: str = "feet",
):
    return tuple(
        Descriptor(
            f"{name}_{leg}",
            unit,
            meaning,
            partial(_of_leg, name=feature, leg=index),
            group=group,
            aspect=aspect,
            concept=concept,
            swings=True,
        )
        for index, leg in enumerate(LEGS)
    )


CONTACTS = _each_leg(
    "contact",
    "foot_contact",
    "1",
    "whether this foot is down",
    "rhythm",
    group="stepping",
)
"""Without telling the legs apart, a trot and a pace of one frequency are the same."""

SINGLE = (
    *_each_leg("foot_height", "foot_height", "m", "height of this foot", "feet"),
    *_each_leg(
        "foot_speed",
        "foot_speed",
        "m/s",
        "horizontal speed of this foot",
        "feet",
        concept="foot speed",
    ),
    *_each_leg(
        "air_time", "foot_air_time", "s", "time since this foot lifted off", "rhythm"
    ),
    Descriptor(
        "left_down",
        "1",
        "sine of the angle by which the left side hangs down",
        partial(_column, name="gravity_b", index=1),
        group="posture",
        aspect="posture",
        concept="leaning",
        signed=True,
    ),
    Descriptor(
        "leftward_speed",
        "m/s",
        "speed to the body's left",
        partial(_column, name="base_lin_vel_b", index=1),
        group="tracking",
        concept="speed",
        signed=True,
    ),
    Descriptor(
        "yaw_rate",
        "rad/s",
        "turning to the left",
        partial(_column, name="base_ang_vel_b", index=2),
        group="tracking",
        concept="speed",
        signed=True,
    ),
)
"""What tells one leg or side from the others: hardly ever what somebody wants."""

TOGETHER = (
    Descriptor(
        "clearance",
        "1",
        "how many feet are well off the ground; none makes up for the others",
        _clearance,
        group="feet",
        aspect="feet",
        concept="foot height",
        swings=True,
    ),
    Descriptor(
        "diagonal_support",
        "1",
        "one pair of diagonal feet down and the other up, as in a trot",
        partial(_apart, first=(0, 3)),
        group="stepping",
        aspect="rhythm",
        concept="trot",
        swings=True,
    ),
    Descriptor(
        "side_support",
        "1",
        "the feet of one side down and those of the other up, as in a pace",
        partial(_apart, first=(0, 2)),
        group="stepping",
        aspect="rhythm",
        concept="pace",
        swings=True,
    ),
    Descriptor(
        "end_support",
        "1",
        "the front or the rear feet down and the others up, as in a bound",
        partial(_apart, first=(0, 1)),
        group="stepping",
        aspect="rhythm",
        concept="bound",
        swings=True,
    ),
    Descriptor(
        "nose_down",
        "1",
        "sine of the angle by which the nose points down",
        partial(_column, name="gravity_b", index=0),
        group="posture",
        aspect="posture",
        concept="nose",
        signed=True,
    ),
)
"""How the legs go together, and whether the nose points up or down."""

ENDS = (
    *_each_end(
        "foot_height",
        "foot_height",
        "m",
        "mean height of these feet",
        "feet",
        "foot height",
    ),
    *_each_end(
        "air_time",
        "foot_air_time",
        "s",
        "mean time since these lifted off",
        "rhythm",
        "air time",
    ),
    *_each_end(
        "contacts",
        "foot_contact",
        "1",
        "share of these feet that are down",
        "rhythm",
        "feet down",
    ),
)
"""Front and rear feet apart: such a habit does not tell left from right, and single
legs would have to say it four times."""
