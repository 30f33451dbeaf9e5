"""The law a policy was trained under: what it sees, and what its actions ask for.

Every vector of joints is in the policy's own order, which `joints` names. Shapes: D
numbers of an observation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from data.errors import GaitprefError
from data.features import JOINTS
from data.files.plain import NONE_AS_BEFORE

from .gait import Gait

Vector = tuple[float, ...]
"""One number for each of the twelve joints."""

WIDTHS = {
    "base_lin_vel": 3,
    "base_ang_vel": 3,
    "projected_gravity": 3,
    "command": 3,
    "joint_pos": 12,
    "joint_pos_abs": 12,
    "joint_vel": 12,
    "last_action": 12,
    "action_before_last": 12,
    "gait_command": 12,
    "gait_clock": 4,
}
"""Terms of an observation and their widths: velocities m/s and turning rates rad/s in
the frame of the base, the direction of gravity there, the command (forward m/s, left
m/s, yaw rad/s), angles less the default pose rad, or as they are, joint velocities
rad/s, the action before and that before it, the gait asked for and its clock."""
MEANINGS = {
    "base_lin_vel": ("m/s", "velocity of the base in its own frame"),
    "base_ang_vel": ("rad/s", "turning rates of the base in its own frame, as a gyro"),
    "projected_gravity": ("1", "unit vector, world down in the frame of the base"),
    "command": ("m/s, m/s, rad/s", "forward, left and turning speed asked for"),
    "joint_pos": ("rad", "angles less default_joint_pos_rad"),
    "joint_pos_abs": ("rad", "angles of the joints"),
    "joint_vel": ("rad/s", "angular velocities of the joints"),
    "last_action": ("1", "the action before, clipped to action_limit; 0 at first"),
    "action_before_last": ("1", "the action before last_action; 0 at first"),
    "gait_command": ("as named", "the numbers of law_record.gait in their order"),
    "gait_clock": (
        "1",
        "sin(2 pi w(x)) of FL FR RL RR; x is the fraction of frequency_hz * t + phase "
        "+ offset + bound, of the same with offset, bound and phase alone; w(x) is x / "
        "(2 duration) below duration, else 0.5 + (x - duration) / (2 - 2 duration); t "
        "is 0 s at first; numbers of law_record.gait",
    ),
}
"""Unit and meaning of every term, before it is clipped and scaled."""
OF_JOINTS = frozenset(
    {"joint_pos", "joint_pos_abs", "joint_vel", "last_action", "action_before_last"}
)
"""Terms with a number for each joint."""
OF_GAITS = frozenset({"gait_command", "gait_clock"})
"""Terms that need a gait to be asked for."""
MOST_FRAMES = 100


class LawError(GaitprefError):
    """A law that cannot be followed."""


@dataclass(frozen=True, kw_only=True)
class Term:
    """One part of an observation: `clip(value) * scale`, of one or more frames."""

    name: str
    """A name of `WIDTHS`."""
    scale: Vector = (1.0,)
    """One number, or one for each column."""
    clip: tuple[float, float] | None = None
    """Bounds before scaling."""
    frames: int = 1
    """Control steps that are shown, the present one included."""

    def __post_init__(self) -> None:
        if self.name not in WIDTHS:
            raise LawError(
                f"an observation has no term {self.name!r}; there are: "
                f"{', '.join(WIDTHS)}"
            )
        if len(self.scale) not in (1, self.width) or not _finite(self.scale):
            raise LawError(
                f"the scale of {self.name} must be one finite number or {self.width}, "
                f"got {list(self.scale)[:13]}"
            )
        if not 1 <= self.frames <= MOST_FRAMES:
            raise LawError(
                f"{self.name} must show 1 to {MOST_FRAMES} frames, got {self.frames}"
            )
        if self.clip is not None and not self.clip[0] < self.clip[1]:
            raise LawError(f"the clip of {self.name} must be (low, high): {self.clip}")

    @property
    def width(self) -> int:
        """Columns of one frame."""
        return WIDTHS[self.name]

    @property
    def scales(self) -> Vector:
        """The scale of every column."""
        return self.scale if len(self.scale) == self.width else self.scale * self.width


@dataclass(frozen=True, kw_only=True)
class Law:
    """What a policy sees and what its actions do: target = offset + scale * action,
    torque = kp (target - angle) - kd velocity within the torque limit."""

    terms: tuple[Term, ...]
    """The parts of an observation, in their order."""
    newest_first: bool = False
    """Order of the frames of a history."""
    by_term: bool = True
    """All frames of a term together, or all terms of a frame."""
    before: Literal["zeros"] | None = field(default=None, metadata=NONE_AS_BEFORE)
    """What was seen before an episode; None is its first frame."""
    gait: Gait | None = field(default=None, metadata=NONE_AS_BEFORE)
    """What a policy with a clock is asked for beside its command."""
    obs_limit: float | None = None
    """Scaled observations are clipped to plus or minus this."""
    joints: tuple[str, ...]
    """The policy's order of the twelve joints, by the names of `JOINTS`."""
    default_joint_pos_rad: Vector
    """The pose that observed angles are measured from, and that the robot begins in."""
    action_scale_rad: Vector
    """Joint offset that an action of 1 asks for."""
    action_offset_rad: Vector
    """Joint angles that an action of 0 asks for."""
    action_limit: float = 100.0
    """Actions are clipped to plus or minus this."""
    target_clip_rad: tuple[tuple[float, float], ...] | None = None
    """Bounds of the joint targets; None leaves them to the torque limits."""
    kp_nm_per_rad: Vector
    """Stiffness."""
    kd_nm_s_per_rad: Vector
    """All the damping there is: nothing of the model is added."""
    torque_limit_nm: Vector | None = None
    """None takes the limits of the robot's model."""
    joint_friction_nm: float | None = None
    """Dry friction of the joints; None leaves what the model has."""
    physics_dt_s: float = 0.005
    """Time step of the motor law."""
    substeps: int = 4
    """Time steps between two actions."""

    def __post_init__(self) -> None:
        if sorted(self.joints) != sorted(JOINTS):
            raise LawError(
                f"joints must name each of {', '.join(JOINTS)} once, got "
                f"{', '.join(self.joints)}"
            )
        if not self.terms or len({t.name for t in self.terms}) != len(self.terms):
            raise LawError("an observation has terms, each of them once")
        if not self.by_term and len({term.frames for term in self.terms}) > 1:
            raise LawError("a history by frames shows as many frames of every term")
        if self.gait is None and OF_GAITS & {term.name for term in self.terms}:
            raise LawError("gait_command and gait_clock need a gait: [gait] in a TOML")
        if self.gait is not None and self.gait.fault is not None:
            raise LawError(f"the gait {self.gait.fault}")
        for name in ("default_joint_pos_rad", "action_scale_rad", "action_offset_rad"):
            _require_vector(name, getattr(self, name), -math.inf)
        _require_vector("kp_nm_per_rad", self.kp_nm_per_rad, 1e-6)
        _require_vector("kd_nm_s_per_rad", self.kd_nm_s_per_rad, 0.0)
        if self.torque_limit_nm is not None:
            _require_vector("torque_limit_nm", self.torque_limit_nm, 1e-6)
        if self.target_clip_rad is not None and len(self.target_clip_rad) != 12:
            raise LawError("target_clip_rad must have 12 pairs")
        if not 1e-4 <= self.physics_dt_s <= 0.05 or not 1 <= self.substeps <= 100:
            raise LawError(
                f"physics_dt_s must lie in [0.0001, 0.05] and substeps in [1, 100], "
                f"got {self.physics_dt_s} and {self.substeps}"
            )
        if not 0 < self.action_limit < 1e9:
            raise LawError(f"action_limit must be positive, got {self.action_limit}")

    @property
    def frame_dim(self) -> int:
        """Numbers of one frame."""
        return sum(term.width for term in self.terms)

    @property
    def obs_dim(self) -> int:
        """Numbers of an observation."""
        return sum(term.width * term.frames for term in self.terms)

    @property
    def control_dt_s(self) -> float:
        """Time between two actions."""
        return self.physics_dt_s * self.substeps

    @property
    def from_canonical(self) -> np.ndarray:
        """[12] where each joint of the policy is in `JOINTS`."""
        return np.array([JOINTS.index(joint) for joint in self.joints])

    @property
    def to_canonical(self) -> np.ndarray:
        """[12] where each joint of `JOINTS` is in the policy's order."""
        return np.array([self.joints.index(joint) for joint in JOINTS])

    def canonical(self, values: Sequence[object]) -> np.ndarray:
        """`values` [12, ...] of the policy's joints, in the order of `JOINTS`."""
        return np.array(values)[self.to_canonical]


def _require_vector(name: str, values: Vector, least: float) -> None:
    if len(values) != 12 or not _finite(values) or min(values) < least:
        bound = "" if least == -math.inf else f" of at least {least:g}"
        raise LawError(
            f"{name} must be 12 finite numbers{bound}, one for each joint, got "
            f"{list(values)[:13]}"
        )


def _finite(values: Vector) -> bool:
    return all(map(math.isfinite, values))
