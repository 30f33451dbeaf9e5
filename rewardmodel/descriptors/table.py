"""Gait descriptors: what a reward model sees of a feature row.

Named, smooth functions of one row. A few hundred comparisons are too few to learn
from 90 raw columns what "shaky" or "dragging its feet" means; they are enough to weigh
two dozen such habits. None needs to know the robot: signs that depend on how a joint is
mounted are squared away. What hardly varies in the first clips and is common in a good
gait (such as standing on two diagonal feet) is left out: answers about the one would be
stretched far beyond what they say of the other. `per_leg` has that, and what tells the
legs apart, for models that pick few of many.

Shapes: F columns of a feature row, D descriptors.
"""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor

from .per_leg import CONTACTS, ENDS, SINGLE, TOGETHER
from .raw_columns import RAW
from .row import Descriptor, Row

_LIFT_OFF_S = 0.05
"""Time over which a lift-off fades: it must be shorter than a swing."""


def _sum_of_squares(values: Tensor) -> Tensor:
    return values.square().sum(dim=-1)


def _planar_error(row: Row) -> Tensor:
    return row["base_lin_vel_b"][..., :2] - row["command"][..., :2]


def _yaw_rate_error(row: Row) -> Tensor:
    return row["base_ang_vel_b"][..., 2] - row["command"][..., 2]


def _tilt_sq(row: Row) -> Tensor:
    """Grow beyond a quarter turn too: a robot on its back is not level."""
    gravity_b = row["gravity_b"]
    sine_sq = _sum_of_squares(gravity_b[..., :2])
    return torch.where(gravity_b[..., 2] > 0, 2.0 - sine_sq, sine_sq)


def _lift_offs(row: Row) -> Tensor:
    """Sum of pulses after lift-offs, nearly the same however long a swing lasts."""
    air_s = row["foot_air_time"]
    return ((air_s > 0) * torch.exp(-air_s.clamp(min=0) / _LIFT_OFF_S)).sum(dim=-1)


DESCRIPTORS = (
    Descriptor(
        "planar_error",
        "m/s",
        "how far the planar velocity is from the one asked for",
        lambda row: _sum_of_squares(_planar_error(row)).sqrt(),
        group="tracking",
        concept="planar error",
    ),
    Descriptor(
        "planar_error_sq",
        "m2/s2",
        "the same, squared",
        lambda row: _sum_of_squares(_planar_error(row)),
        quadratic=True,
        group="tracking",
    ),
    Descriptor(
        "yaw_rate_error",
        "rad/s",
        "how far the yaw rate is from the one asked for",
        lambda row: _yaw_rate_error(row).abs(),
        group="tracking",
        concept="yaw rate error",
    ),
    Descriptor(
        "yaw_rate_error_sq",
        "rad2/s2",
        "the same, squared",
        lambda row: _yaw_rate_error(row).square(),
        quadratic=True,
        group="tracking",
    ),
    Descriptor(
        "forward_speed",
        "m/s",
        "speed along the body's nose, whatever was asked for",
        lambda row: row["base_lin_vel_b"][..., 0],
        group="tracking",
        concept="speed",
        signed=True,
    ),
    Descriptor(
        "vertical_speed_sq",
        "m2/s2",
        "bouncing",
        lambda row: row["base_lin_vel_b"][..., 2].square(),
        quadratic=True,
        group="steadiness",
        aspect="steadiness",
        concept="steadiness",
    ),
    Descriptor(
        "roll_rate_sq",
        "rad2/s2",
        "swaying from side to side",
        lambda row: row["base_ang_vel_b"][..., 0].square(),
        quadratic=True,
        group="steadiness",
        aspect="steadiness",
        concept="steadiness",
    ),
    Descriptor(
        "pitch_rate_sq",
        "rad2/s2",
        "rocking from nose to tail",
        lambda row: row["base_ang_vel_b"][..., 1].square(),
        quadratic=True,
        group="steadiness",
        aspect="steadiness",
        concept="steadiness",
    ),
    Descriptor(
        "tilt_sq",
        "1",
        "squared sine of the angle between the body's up and the world's; 2 less it "
        "where the body is upside down",
        _tilt_sq,
        quadratic=True,
        group="steadiness",
        aspect="posture",
        concept="uprightness",
    ),
    Descriptor(
        "height",
        "m",
        "height of the base above the ground",
        lambda row: row["base_height"][..., 0],
        group="posture",
        aspect="posture",
        concept="trunk height",
    ),
    Descriptor(
        "height_sq",
        "m2",
        "the same, squared: with `height` it can name a best height",
        lambda row: row["base_height"][..., 0].square(),
        group="posture",
        aspect="posture",
    ),
    Descriptor(
        "joint_offset_sq",
        "rad2",
        "distance of all joints from the home pose",
        lambda row: _sum_of_squares(row["joint_pos_offset"]),
        quadratic=True,
        group="posture",
        aspect="posture",
        concept="uprightness",
    ),
    Descriptor(
        "joint_speed_sq",
        "rad2/s2",
        "how fast the joints move",
        lambda row: _sum_of_squares(row["joint_vel"]),
        quadratic=True,
        group="effort",
        aspect="effort",
        concept="effort",
    ),
    Descriptor(
        "torque_sq",
        "N2 m2",
        "how hard the joints work",
        lambda row: _sum_of_squares(row["joint_torque"]),
        quadratic=True,
        group="effort",
        aspect="effort",
        concept="effort",
    ),
    Descriptor(
        "power",
        "W",
        "mechanical power, braking counted as much as driving",
        lambda row: (row["joint_torque"] * row["joint_vel"]).abs().sum(dim=-1),
        quadratic=True,
        group="effort",
        aspect="effort",
        concept="effort",
    ),
    Descriptor(
        "action_sq",
        "1",
        "how far the policy pulls from the home pose",
        lambda row: _sum_of_squares(row["action"]),
        quadratic=True,
        group="shaking",
        aspect="effort",
        concept="shaking",
    ),
    Descriptor(
        "action_rate_sq",
        "1",
        "how much the policy's output jumps from step to step: shaking",
        lambda row: _sum_of_squares(row["action_rate"]),
        quadratic=True,
        group="shaking",
        aspect="effort",
        concept="shaking",
    ),
    Descriptor(
        "contacts",
        "1",
        "number of feet on the ground",
        lambda row: row["foot_contact"].sum(dim=-1),
        group="feet",
        aspect="rhythm",
        concept="feet down",
        swings=True,
    ),
    Descriptor(
        "foot_height_mean",
        "m",
        "mean height of the four feet",
        lambda row: row["foot_height"].mean(dim=-1),
        group="feet",
        aspect="feet",
        concept="foot height",
        swings=True,
    ),
    Descriptor(
        "foot_height_max",
        "m",
        "height of the highest foot",
        lambda row: row["foot_height"].amax(dim=-1),
        group="feet",
        aspect="feet",
        concept="foot height",
        swings=True,
    ),
    Descriptor(
        "foot_speed_mean",
        "m/s",
        "mean horizontal speed of the four feet",
        lambda row: row["foot_speed"].mean(dim=-1),
        group="feet",
        aspect="feet",
        concept="foot speed",
        swings=True,
    ),
    Descriptor(
        "slip",
        "m2/s2",
        "squared speed of the feet on the ground, summed",
        lambda row: (row["foot_contact"] * row["foot_speed"].square()).sum(dim=-1),
        quadratic=True,
        group="feet",
        aspect="feet",
        concept="slip",
        swings=True,
    ),
    Descriptor(
        "air_time_mean",
        "s",
        "mean time since lift-off of the four feet",
        lambda row: row["foot_air_time"].mean(dim=-1),
        group="feet",
        aspect="rhythm",
        concept="air time",
        swings=True,
    ),
    Descriptor(
        "air_time_max",
        "s",
        "time since lift-off of the foot longest in the air",
        lambda row: row["foot_air_time"].amax(dim=-1),
        group="feet",
        aspect="rhythm",
        concept="air time",
        swings=True,
    ),
    Descriptor(
        "lift_offs",
        "1",
        "how often feet leave the ground: short steps instead of long ones",
        _lift_offs,
        group="feet",
        aspect="rhythm",
        concept="rate of steps",
        swings=True,
    ),
)

DESCRIPTOR_NAMES = tuple(descriptor.name for descriptor in DESCRIPTORS)

Sight = Literal["habits", "contacts", "legs", "rows"]
"""What a model sees: the table, the contact of each foot besides, all of
`rewardmodel.descriptors.per_leg`, or none of these but the rows themselves."""
_SEEN: dict[Sight, tuple[Descriptor, ...]] = {
    "habits": DESCRIPTORS,
    "contacts": DESCRIPTORS + CONTACTS,
    "legs": DESCRIPTORS + CONTACTS + SINGLE + TOGETHER + ENDS,
    "rows": RAW,
}


def names_seen(sight: Sight) -> tuple[str, ...]:
    """Names of the columns of `describe`."""
    return tuple(descriptor.name for descriptor in _SEEN[sight])


def columns_seen(sight: Sight) -> tuple[Descriptor, ...]:
    """What the columns of `describe` are."""
    return _SEEN[sight]


def describe(features: Tensor, sight: Sight = "habits") -> Tensor:
    """Descriptors [..., D] of feature rows [..., F], float32, in table order.

    Logged clips and live batches go through this one function. A row that is not finite
    gives descriptors that are not finite. Who sees more habits has the columns of those
    who see fewer in front.
    """
    row = Row(features)
    return torch.stack([item.compute(row) for item in _SEEN[sight]], dim=-1)
