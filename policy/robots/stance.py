"""The pose a robot stands in: what its model says, or else one that was found.

Shapes: nq positions of the model, L = 4 legs of three joints.
"""

from __future__ import annotations

from itertools import product

import mujoco
import numpy as np

from data.features import JOINTS, LEGS

from .anatomy import Skeleton, stored_home
from .hints import RobotError, table_of
from .legs import STANDING_S, Legs

DROP_SHARE = 0.7
"""Height of the thigh's joint above the foot in a found pose, of the stretched leg."""

GAP_M = 0.02
"""How far above or below the floor the feet of a given pose may be."""


def ensure_home(spec: mujoco.MjSpec, skeleton: Skeleton) -> str | None:
    """Give `spec` a key "home" in which the robot stands; tells where it is from.

    `skeleton` is of the model `spec` compiles to, with its servos and its floor.

    Raises:
        RobotError: no pose was found in which it stands.
    """
    found, told = _find_home(Legs(skeleton))
    if np.array_equal(found, stored_home(skeleton.mj_model)):
        return None
    for key in list(spec.keys):
        if key.name == "home":
            spec.delete(key)
    spec.add_key(name="home", qpos=found)
    return told


def _find_home(legs: Legs) -> tuple[np.ndarray, str]:
    """A pose [nq] to stand in, and where it is from."""
    skeleton = legs.skeleton
    mj_model = skeleton.mj_model
    if skeleton.hints.home:
        qpos = _upright(mj_model)
        qpos[skeleton.joint_qpos] = [
            a for leg in LEGS for a in skeleton.hints.home[leg]
        ]
        return _tried(legs, legs.on_floor(qpos)), "home is that of the TOML file"
    for key in range(mj_model.nkey):
        name = mj_model.key(key).name
        if name.lower().startswith(("home", "stand")):
            qpos = legs.on_floor(mj_model.key_qpos[key].copy(), GAP_M)
            if legs.bent(qpos) and legs.stands(qpos):
                return qpos, f"home is the keyframe {name!r}, put on the floor"
    for given, told in [
        *((qpos, "a keyframe") for qpos in mj_model.key_qpos),
        (mj_model.qpos0, "the pose of the file without a keyframe"),
    ]:
        qpos = legs.on_floor(given.copy(), GAP_M)
        if legs.bent(qpos) and _within_ranges(mj_model, qpos) and legs.stands(qpos):
            return qpos, f"home is {told}, put on the floor"
    qpos = search_home(legs)
    if legs.stands(qpos):
        return qpos, "home was searched: feet below the hips, knees bent"
    angles = qpos[skeleton.joint_qpos].reshape(4, 3).round(2)
    raise RobotError(
        f"{skeleton.source}: it has no keyframe to stand in, and it falls in the poses "
        f"that were tried, in the last as {legs.falls(qpos)}{_too_soft(skeleton)}; "
        "write a better one than the last, hip thigh calf in rad, into a TOML file "
        "beside the model",
        table_of("home", angles.tolist()),
    )


def _tried(legs: Legs, qpos: np.ndarray) -> np.ndarray:
    """The pose `qpos` [nq] that somebody said, in which the robot stands.

    Raises:
        RobotError: it does not, or the pose is beyond the limits of a joint.
    """
    skeleton = legs.skeleton
    mj_model = skeleton.mj_model
    for name, joint in zip(JOINTS, skeleton.joints, strict=True):
        angle = float(qpos[mj_model.jnt_qposadr[joint]])
        low, high = map(float, mj_model.jnt_range[joint])
        if mj_model.jnt_limited[joint] and not low <= angle <= high:
            raise RobotError(
                f"{skeleton.source}: [home] of its TOML file says {angle:g} rad for "
                f"{name}, whose joint {mj_model.joint(joint).name!r} moves from "
                f"{low:.3g} to {high:.3g}; give an angle within"
            )
    if fall := legs.falls(qpos):
        raise RobotError(
            f"{skeleton.source}: in the pose of [home] of its TOML file it does not "
            f"stand for {STANDING_S:g} s: {fall}{_too_soft(skeleton)}; give another "
            "pose, or leave [home] out to have one searched"
        )
    return qpos


def _too_soft(skeleton: Skeleton) -> str:
    """That the stiffness which was said may be the reason, if it was said."""
    kp = (skeleton.hints.servo or {}).get("kp")
    return f" (with the kp of [servo], {kp} N m/rad)" if kp else ""


def search_home(legs: Legs) -> np.ndarray:
    """A pose [nq] on the floor with every foot below its thigh's joint, knees bent.

    The legs are searched side by side: a coarse grid over the ranges of their joints,
    then ever finer ones around the best.
    """
    skeleton = legs.skeleton
    mj_model, joints = skeleton.mj_model, list(skeleton.joints)
    mj_data, qpos = mujoco.MjData(mj_model), _upright(mj_model)
    adr = skeleton.joint_qpos.reshape(4, 3)
    limited = mj_model.jnt_limited[joints, None] > 0
    ranges = np.where(limited, mj_model.jnt_range[joints], (-np.pi, np.pi))
    low, high = np.moveaxis(ranges.clip(-np.pi, np.pi).reshape(4, 3, 2), -1, 0)

    def costs(angles: np.ndarray) -> np.ndarray:
        """[L] how bad the `angles` [L, 3] of the legs are."""
        mj_data.qpos[:] = qpos
        mj_data.qpos[adr] = angles
        mujoco.mj_kinematics(mj_model, mj_data)
        hip_w, thigh_w, knee_w = (mj_data.xanchor[joints[i::3]] for i in range(3))
        offsets = (legs.tips_w(mj_data) - thigh_w) / legs.reach_m[:, None]
        inwards = np.abs(thigh_w[:, 1]) < np.abs(hip_w[:, 1]) - 1e-3
        forwards = knee_w[:, 0] > thigh_w[:, 0]
        misses = np.square(offsets - wanted).sum(axis=1)
        return misses + 0.05 * inwards + 0.01 * forwards

    wanted = np.array([0.0, 0.0, -DROP_SHARE])
    best, best_cost = (low + high) / 2, np.full(4, np.inf)

    def consider(angles: np.ndarray) -> None:
        nonlocal best, best_cost
        cost = costs(angles)
        best = np.where((cost < best_cost)[:, None], angles, best)
        best_cost = np.minimum(cost, best_cost)

    for share in product(np.linspace(0, 1, 9), *[np.linspace(0, 1, 15)] * 2):
        consider(low + np.array(share) * (high - low))
    for halvings in range(10):
        center, step = best, (high - low) / 14 / 1.6**halvings
        for offset in product((-1.0, 0.0, 1.0), repeat=3):
            consider((center + step * offset).clip(low, high))
    qpos[adr] = best
    return legs.on_floor(qpos)


def _upright(mj_model: mujoco.MjModel) -> np.ndarray:
    qpos = mj_model.qpos0.copy()
    qpos[:7] = (0, 0, 0, 1, 0, 0, 0)
    return qpos


def _within_ranges(mj_model: mujoco.MjModel, qpos: np.ndarray) -> bool:
    joints = np.flatnonzero(mj_model.jnt_limited)
    angles = qpos[mj_model.jnt_qposadr[joints]]
    low, high = mj_model.jnt_range[joints].T
    return bool(((low <= angles) & (angles <= high)).all())
