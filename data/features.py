"""The feature row: what a reward, a criterion or a rater may look at.

One float32 row per control step, computed after the step and before any reset. A
feature that nobody measured, as on hardware, is NaN in every step of its episode.

Shapes: F columns of a row (`FEATURE_DIM`).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cache

import numpy as np

LEGS = ("FR", "FL", "RR", "RL")
"""Order of the legs everywhere: front right, front left, rear right, rear left."""

JOINTS = tuple(f"{leg}_{joint}" for leg in LEGS for joint in ("hip", "thigh", "calf"))
"""Order of the twelve joints everywhere."""


@dataclass(frozen=True)
class Feature:
    """One named group of columns of the feature row."""

    name: str
    width: int
    """Number of columns."""
    unit: str
    meaning: str


FEATURES = (
    Feature("base_lin_vel_b", 3, "m/s", "linear velocity of the base, body frame"),
    Feature("base_ang_vel_b", 3, "rad/s", "angular velocity of the base, body frame"),
    Feature("gravity_b", 3, "1", "world down in the body frame"),
    Feature("base_height", 1, "m", "height of the base above the ground below it"),
    Feature("command", 3, "m/s, m/s, rad/s", "forward, left and yaw asked for"),
    Feature("joint_pos_offset", 12, "rad", "joint positions from the home pose"),
    Feature("joint_vel", 12, "rad/s", "joint velocities"),
    Feature("joint_torque", 12, "N m", "torque applied at the joints"),
    Feature("action", 12, "1", "policy output after clipping"),
    Feature("action_rate", 12, "1", "action[t] - action[t-1]"),
    Feature("foot_contact", 4, "0 or 1", "foot touches the ground"),
    Feature("foot_height", 4, "m", "lowest point of the foot above the ground"),
    Feature("foot_speed", 4, "m/s", "horizontal speed of the foot, world frame"),
    Feature("foot_air_time", 4, "s", "time since lift-off; 0 in contact"),
    Feature("fallen", 1, "0 or 1", "this step ends the episode by a fall"),
)

FEATURE_DIM = sum(feature.width for feature in FEATURES)


@cache
def columns() -> dict[str, slice]:
    """The slice of every feature by name."""
    slices: dict[str, slice] = {}
    start = 0
    for feature in FEATURES:
        slices[feature.name] = slice(start, start + feature.width)
        start += feature.width
    return slices


def column(name: str) -> slice:
    """The slice of the last axis of `features [..., F]` that holds `name`.

    Raises:
        ValueError: there is no such feature; the message lists those there are.
    """
    try:
        return columns()[name]
    except KeyError:
        known = ", ".join(columns())
        raise ValueError(f"there is no feature {name!r}; there are: {known}") from None


def missing_features(rows: np.ndarray) -> tuple[str, ...]:
    """Names of the features that rows [T, F] say nothing about."""
    return tuple(
        name for name, part in columns().items() if np.isnan(rows[:, part]).all()
    )


@cache
def features_sha256() -> str:
    """Hash of the names, widths and units, to refuse what was made for another row."""
    text = "\n".join(f"{f.name} {f.width} {f.unit}" for f in FEATURES)
    return hashlib.sha256(text.encode()).hexdigest()
