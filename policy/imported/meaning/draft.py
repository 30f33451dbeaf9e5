"""What is known of a law so far, who said it, and what was guessed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal

import mujoco
import numpy as np

from data.features import JOINTS
from policy.law.gait import Gait
from policy.law.law import Law, LawError, Term, Vector
from policy.robots.robot import Robot

from .joint_names import canonical_joints

BY_TYPE = tuple(
    f"{leg}_{part}"
    for part in ("hip", "thigh", "calf")
    for leg in ("FL", "FR", "RL", "RR")
)
"""The order of Isaac Sim, which goes through the legs joint by joint."""
LEFT_FIRST = tuple(
    f"{leg}_{part}"
    for leg in ("FL", "FR", "RL", "RR")
    for part in ("hip", "thigh", "calf")
)
"""The order of Isaac Gym, which sorts by name."""
RIGHT_FIRST = tuple(
    f"{leg}_{part}"
    for leg in ("FR", "FL", "RR", "RL")
    for part in ("hip", "thigh", "calf")
)
"""The order of Unitree's motors."""
INSTEAD = (
    "say the law in a TOML (--explain prints one, --law takes it), or take a --preset"
)
"""What helps where a file cannot be read."""
_HEIGHTS = (187, 231)
"""Numbers of the height scans that are usual: 17 x 11, 21 x 11."""


@dataclass(frozen=True, kw_only=True)
class Draft:
    """A law as far as it is known; None is not known. Joints in the source's order."""

    source: str
    """Who says so, in words."""
    robot: str | None = None
    """What the source calls its robot."""
    carried: bool = False
    """Whether the robot's model is written beside the policy, as of ours."""
    joints: tuple[str, ...] | None = None
    """Their names as the source spells them."""
    terms: tuple[Term, ...] | None = None
    newest_first: bool | None = None
    by_term: bool | None = None
    before: Literal["zeros"] | None = None
    gait: Gait | None = None
    obs_limit: float | None = None
    default_joint_pos_rad: Vector | None = None
    action_scale_rad: Vector | None = None
    action_offset_rad: Vector | None = None
    """None is the default pose."""
    action_limit: float | None = None
    target_clip_rad: tuple[tuple[float, float], ...] | None = None
    kp_nm_per_rad: Vector | None = None
    kd_nm_s_per_rad: Vector | None = None
    torque_limit_nm: Vector | None = None
    joint_friction_nm: float | None = None
    physics_dt_s: float | None = None
    substeps: int | None = None
    activation: str | None = None
    """Between the layers, where a checkpoint does not say it."""
    guessed: Mapping[str, str] = field(default_factory=dict)
    """Fields that nobody said, and why they are what they are."""

    def over(self, other: Draft) -> Draft:
        """This draft, with what it leaves open out of `other`."""
        taken = {
            each.name: getattr(other, each.name)
            for each in fields(self)
            if getattr(self, each.name) is None
        }
        said = {name for name in _LAW_FIELDS if getattr(self, name) is not None}
        guessed = {n: w for n, w in other.guessed.items() if n not in said}
        return replace(
            self,
            **taken,
            carried=self.carried or other.carried,
            source=f"{self.source}, over {other.source}",
            guessed={**guessed, **self.guessed},
        )

    def guess(self, name: str, value: Any, why: str) -> Draft:
        """This draft with a field that nobody said, if it is open."""
        if getattr(self, name) is not None:
            return self
        return replace(self, **{name: value}, guessed={**self.guessed, name: why})


_LAW_FIELDS = tuple(each.name for each in fields(Law))
NEEDED = (
    "terms",
    "default_joint_pos_rad",
    "action_scale_rad",
    "kp_nm_per_rad",
    "kd_nm_s_per_rad",
)
"""What no rule gives."""


def names_of(robot: Robot) -> list[str]:
    """[12] what the model calls its joints, in the order of `JOINTS`."""
    model: mujoco.MjModel = robot.mj_model
    ids = [int(np.flatnonzero(model.jnt_qposadr == adr)[0]) for adr in robot.qpos_adr]
    return [model.joint(joint).name for joint in ids]


def spelled_by(robot: Robot) -> dict[str, str]:
    """What the model calls each of `JOINTS`, in the order of the model."""
    named = dict(zip(JOINTS, names_of(robot), strict=True))
    return {JOINTS[i]: named[JOINTS[i]] for i in np.argsort(robot.qpos_adr)}


def with_guesses(draft: Draft, obs_dim: int) -> Draft:
    """`draft` with rules in the place of what nobody said, each of them told."""
    draft = draft.guess("joints", LEFT_FIRST, "FL FR RL RR, as most trainers have it")
    draft = draft.guess("physics_dt_s", 0.005, "5 ms, as most trainers have it")
    draft = draft.guess("substeps", 4, "4, an action every 20 ms with 5 ms of physics")
    if draft.terms is None:
        return draft
    terms = draft.terms
    width = sum(term.width for term in terms)
    shown = sum(term.width * term.frames for term in terms)
    once = all(term.frames == 1 for term in terms)
    if shown != obs_dim and once and obs_dim % width == 0:
        frames = obs_dim // width
        terms = tuple(replace(term, frames=frames) for term in terms)
        why = f"{frames} frames, since the network takes {obs_dim} numbers"
        draft = replace(draft, terms=terms, guessed={**draft.guessed, "frames": why})
    if any(term.frames > 1 for term in terms):
        draft = draft.guess("by_term", True, "all frames of a term together")
        draft = draft.guess("newest_first", False, "the oldest frame first")
    return draft


def complete(draft: Draft, robot: Robot, obs_dim: int) -> Law:
    """The law of `draft` on `robot`.

    Raises:
        LawError: something is missing, or does not fit the network or the robot.
    """
    missing = [name for name in NEEDED if getattr(draft, name) is None]
    if missing:
        raise LawError(
            f"{draft.source} does not say {', '.join(missing)}: `gaitpref policy "
            "import FILE --explain` prints a TOML to fill in, which --law takes"
        )
    assert draft.terms is not None
    require_width(draft.terms, obs_dim, draft.source)
    assert draft.joints is not None
    joints = canonical_joints(draft.joints, names_of(robot))
    values = {
        each.name: getattr(draft, each.name)
        for each in fields(Law)
        if getattr(draft, each.name, None) is not None
    }
    values.setdefault("action_offset_rad", draft.default_joint_pos_rad)
    values["joints"] = joints
    return Law(**values)


def require_width(terms: Sequence[Term], obs_dim: int, source: str) -> None:
    """Make sure that terms are what the network takes.

    Raises:
        LawError: they are not.
    """
    shown = sum(term.width * term.frames for term in terms)
    if shown == obs_dim:
        return
    told = ", ".join(f"{term.name} {term.width * term.frames}" for term in terms)
    if obs_dim - shown in _HEIGHTS:
        raise LawError(
            f"the network takes {obs_dim} numbers, {obs_dim - shown} more than the "
            f"terms of {source}: these are a scan of heights, and policies that see "
            "the ground are not taken; give one trained on flat ground"
        )
    raise LawError(
        f"the network takes {obs_dim} numbers, and {source} says {shown}: {told}; "
        f"{INSTEAD}"
    )


def twelve(value: Any, name: str) -> Vector:
    """A number, or a list of twelve, as a vector.

    Raises:
        LawError: it is something else.
    """
    values = value if isinstance(value, list | tuple) else [value] * 12
    if len(values) != 12 or not all(number_of(v) is not None for v in values):
        raise LawError(f"{name} must be a number or 12 of them, got {str(value)[:80]}")
    try:
        return tuple(float(v) for v in values)
    except OverflowError:
        raise LawError(f"{name} has a number that is too large") from None


def order_of(value: Any, name: str) -> list[int]:
    """A list of the numbers 0 to 11 in an order of its own.

    Raises:
        LawError: it is something else.
    """
    whole = isinstance(value, list) and all(type(each) is int for each in value)
    if not whole or sorted(value) != list(range(12)):
        raise LawError(
            f"{name} must have each of 0 to 11 once, for 12 joints, got "
            f"{str(value)[:80]}"
        )
    return value


def whole_of(value: Any, name: str) -> int | None:
    """A whole number of at least 1; None and 0 are not said.

    Raises:
        LawError: it is something else.
    """
    if value is None or value == 0:
        return None
    if number_of(value) is None or not 1 <= value <= 1000 or value != int(value):
        raise LawError(
            f"{name} must be a whole number from 1 to 1000, got {str(value)[:40]}"
        )
    return int(value)


def robot_name(value: Any) -> str | None:
    """What a source calls its robot, in one line; None of what is no name."""
    if not isinstance(value, str):
        return None
    return "".join(filter(str.isprintable, value[:60])).strip() or None


def number_of(value: Any) -> float | None:
    """A number; None of anything else."""
    good = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if good else None
