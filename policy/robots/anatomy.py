"""Which body, joints, servos and feet of a compiled model make up the quadruped.

Legs and joints come in the order of `data.features.LEGS` and `data.features.JOINTS`,
whatever the model calls them and however it orders them.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from data.errors import GaitprefError

from .foot import Foot, find_foot


class RobotError(GaitprefError):
    """The model of a robot cannot be used; one line says why and what to do."""


@dataclass(frozen=True, eq=False)
class Anatomy:
    """What was found in a compiled model, as ids."""

    base: int
    """The body with the free joint."""
    joints: tuple[int, ...]
    """[12]"""
    servos: tuple[int, ...]
    """[12] the position actuator of every joint."""
    feet: tuple[Foot, ...]
    """[4]"""
    home_qpos: np.ndarray
    """[nq] the pose in which the feet were measured."""


def find_anatomy(mj_model: mujoco.MjModel, source: str) -> Anatomy:
    """The parts of the quadruped in `mj_model`; `source` names it in errors.

    Raises:
        RobotError: it has no free base, not twelve hinges in four legs of three, a
            joint without position actuator, a leg that collides with nothing, or no
            pose to stand in.
    """
    base = _find_base(mj_model, source)
    joints = _find_joints(mj_model, base, source)
    servos = tuple(_find_servo(mj_model, joint, source) for joint in joints)
    home_qpos = _find_home(mj_model, source)
    mj_data = mujoco.MjData(mj_model)
    mj_data.qpos[:] = home_qpos
    mujoco.mj_kinematics(mj_model, mj_data)
    feet: list[Foot] = []
    for joint in joints[2::3]:
        shank = int(mj_model.jnt_bodyid[joint])
        foot = find_foot(mj_model, mj_data, bodies_below(mj_model, shank))
        if foot is None:
            raise RobotError(
                f"{source}: body {mj_model.body(shank).name!r} at the end of a leg has "
                "no geom that collides; give it a foot to stand on, for example "
                '<geom type="sphere" size="0.02" pos="0 0 -0.2"/>'
            )
        feet.append(foot)
    return Anatomy(base, joints, servos, tuple(feet), home_qpos)


def bodies_below(mj_model: mujoco.MjModel, body: int) -> list[int]:
    """`body` and everything that hangs on it."""
    # Bodies are numbered depth first: a subtree is one run that ends at the first
    # body whose parent lies before it.
    last = body + 1
    while last < mj_model.nbody and mj_model.body_parentid[last] >= body:
        last += 1
    return list(range(body, last))


def _find_base(mj_model: mujoco.MjModel, source: str) -> int:
    """The body that carries the only free joint."""
    free = np.flatnonzero(mj_model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    if len(free) != 1:
        raise RobotError(
            f"{source}: found {len(free)} free joints where a quadruped alone on its "
            "ground has 1; give its base body a <freejoint/> and take other loose "
            "bodies away"
        )
    return int(mj_model.jnt_bodyid[free[0]])


def _find_joints(mj_model: mujoco.MjModel, base: int, source: str) -> tuple[int, ...]:
    """The twelve hinges on `base`, in the order of `JOINTS`."""
    moving = np.flatnonzero(
        np.isin(mj_model.jnt_bodyid, bodies_below(mj_model, base))
        & (mj_model.jnt_type != mujoco.mjtJoint.mjJNT_FREE)
    )
    hinges = int(np.sum(mj_model.jnt_type[moving] == mujoco.mjtJoint.mjJNT_HINGE))
    if (hinges, len(moving)) != (12, 12):
        raise RobotError(
            f"{source}: found {hinges} hinge joints and {len(moving) - hinges} joints "
            f"of other kinds on body {mj_model.body(base).name!r} where a quadruped "
            "has 12 and 0; take away the joints that are not part of a leg"
        )
    # Joints are numbered depth first as well: a hinge whose body hangs on the body
    # of the hinge before it goes on with that chain, another begins a leg.
    legs: list[list[int]] = []
    for joint in moving.tolist():
        body = int(mj_model.jnt_bodyid[joint])
        if legs and body in bodies_below(mj_model, mj_model.jnt_bodyid[legs[-1][-1]]):
            legs[-1].append(joint)
        else:
            legs.append([joint])
    if [len(leg) for leg in legs] != [3, 3, 3, 3]:
        raise RobotError(
            f"{source}: the 12 hinges form chains of {[len(leg) for leg in legs]} "
            "joints where a quadruped has 4 legs of 3; nest each leg's bodies as "
            "hip, thigh, calf"
        )
    return tuple(
        joint for leg in _sort_legs(mj_model, base, legs, source) for joint in leg
    )


def _sort_legs(
    mj_model: mujoco.MjModel, base: int, legs: list[list[int]], source: str
) -> list[list[int]]:
    """Four chains of joints in the order of `LEGS`, told apart by where they begin."""
    mj_data = mujoco.MjData(mj_model)
    mujoco.mj_kinematics(mj_model, mj_data)
    from_base_w = mj_data.xanchor[[leg[0] for leg in legs]] - mj_data.xpos[base]
    start_b = from_base_w @ mj_data.xmat[base].reshape(3, 3)  # [4, 3]
    x, y = (start_b - start_b.mean(axis=0)).T[:2]
    corners = {
        (bool(front), bool(left)): leg
        for front, left, leg in zip(x > 0, y > 0, legs, strict=True)
    }
    if len(corners) != 4:
        places = ", ".join(f"({px:.2f}, {py:.2f})" for px, py, _ in start_b)
        raise RobotError(
            f"{source}: the legs begin at (x, y) = {places} of the base where one is "
            "expected in each corner; turn the base so that x points forward and y left"
        )
    return [
        corners[at]
        for at in ((True, False), (True, True), (False, False), (False, True))
    ]


def _find_servo(mj_model: mujoco.MjModel, joint: int, source: str) -> int:
    """The one actuator of `joint`, which must be a position servo."""
    on_joint = np.isin(
        mj_model.actuator_trntype,
        (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT),
    ) & (mj_model.actuator_trnid[:, 0] == joint)
    found = np.flatnonzero(on_joint).tolist()
    name = mj_model.joint(joint).name
    todo = f'write <position joint="{name}" kp="35"/>'
    if len(found) != 1:
        raise RobotError(
            f"{source}: joint {name!r} has {len(found)} actuators where a position "
            f"servo is needed; {todo}"
        )
    if not is_position_servo(mj_model, found[0]):
        raise RobotError(
            f"{source}: actuator {mj_model.actuator(found[0]).name!r} of joint "
            f"{name!r} is no position servo (fixed gain kp, affine bias -kp, gear 1, "
            f"no activation), and no other kind is supported; {todo} instead"
        )
    return found[0]


def is_position_servo(mj_model: mujoco.MjModel, actuator: int) -> bool:
    """Whether its force is kp * (control - angle), perhaps with damping."""
    kp = mj_model.actuator_gainprm[actuator, 0]
    return bool(
        mj_model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
        and mj_model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_AFFINE
        and mj_model.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_NONE
        and kp > 0
        and np.array_equal(mj_model.actuator_biasprm[actuator, :2], (0.0, -kp))
        and mj_model.actuator_gear[actuator, 0] == 1.0
    )


def _find_home(mj_model: mujoco.MjModel, source: str) -> np.ndarray:
    """Home pose [nq]: the keyframe "home", else the first one, else qpos0."""
    if mj_model.nkey:
        home = mujoco.mj_name2id(mj_model, mujoco.mjtObj.mjOBJ_KEY, "home")
        return mj_model.key_qpos[max(home, 0)].copy()
    for joint in np.flatnonzero(mj_model.jnt_limited):
        low, high = mj_model.jnt_range[joint]
        angle = mj_model.qpos0[mj_model.jnt_qposadr[joint]]
        if not low <= angle <= high:
            raise RobotError(
                f"{source}: there is no keyframe, and joint "
                f"{mj_model.joint(joint).name!r} at {angle:g} rad is outside its range "
                f"{low:g} to {high:g}; add the pose to stand in as "
                '<keyframe><key name="home" qpos="..."/></keyframe>'
            )
    return mj_model.qpos0.copy()
