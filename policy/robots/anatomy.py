"""Which body, joints, servos and feet of a compiled model make up the quadruped.

Legs and joints come in the order of `data.features.LEGS` and `data.features.JOINTS`,
whatever the model calls them and however it orders them.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from data.features import JOINTS, LEGS

from .foot import Foot, find_foot
from .hints import Hints, RobotError, table_of


@dataclass(frozen=True, eq=False)
class Skeleton:
    """The legs of a compiled model."""

    mj_model: mujoco.MjModel
    joints: tuple[int, ...]
    """[12] in the order of `JOINTS`"""
    source: str
    """Names the model in errors."""
    hints: Hints

    @property
    def joint_qpos(self) -> np.ndarray:
        """[12] address of every joint in qpos."""
        return self.mj_model.jnt_qposadr[list(self.joints)]

    def posed(self, qpos: np.ndarray) -> mujoco.MjData:
        """Where everything is in the pose `qpos` [nq]."""
        mj_data = mujoco.MjData(self.mj_model)
        mj_data.qpos[:] = qpos
        mujoco.mj_kinematics(self.mj_model, mj_data)
        return mj_data

    def feet(self, qpos: np.ndarray) -> tuple[Foot, ...]:
        """The four feet, measured in the pose `qpos` [nq].

        Raises:
            RobotError: a leg collides with nothing.
        """
        mj_model, mj_data = self.mj_model, self.posed(qpos)
        feet: list[Foot] = []
        for leg, joint in zip(LEGS, self.joints[2::3], strict=True):
            shank = int(mj_model.jnt_bodyid[joint])
            name = self.hints.feet[leg] if self.hints.feet else None
            foot = find_foot(mj_model, mj_data, bodies_below(mj_model, shank), name)
            if foot is None:
                raise _no_foot(mj_model, leg, shank, name, self.source)
            feet.append(foot)
        return tuple(feet)


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


def find_anatomy(mj_model: mujoco.MjModel, source: str, hints: Hints) -> Anatomy:
    """The parts of the quadruped in `mj_model`, which has servos and a home pose.

    Args:
        mj_model: The model.
        source: Names the model in errors.
        hints: Where legs and feet are, if that was said.

    Raises:
        RobotError: it has no free base, not twelve hinges in four legs of three, or a
            leg that collides with nothing.
    """
    base = find_base(mj_model, source)
    joints = find_joints(mj_model, base, source, hints)
    servos = tuple(actuators_of(mj_model, joint)[0] for joint in joints)
    home_qpos = stored_home(mj_model)
    feet = Skeleton(mj_model, joints, source, hints).feet(home_qpos)
    return Anatomy(base, joints, servos, feet, home_qpos)


def bodies_below(mj_model: mujoco.MjModel, body: int) -> list[int]:
    """`body` and everything that hangs on it."""
    # Bodies are numbered depth first: a subtree is one run that ends at the first
    # body whose parent lies before it.
    last = body + 1
    while last < mj_model.nbody and mj_model.body_parentid[last] >= body:
        last += 1
    return list(range(body, last))


def find_base(mj_model: mujoco.MjModel, source: str) -> int:
    """The body that carries the only free joint."""
    free = np.flatnonzero(mj_model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    if len(free) != 1:
        raise RobotError(
            f"{source}: found {len(free)} free joints where a quadruped alone on its "
            "ground has 1; give its base body a <freejoint/> and take other loose "
            "bodies away"
        )
    return int(mj_model.jnt_bodyid[free[0]])


def find_joints(
    mj_model: mujoco.MjModel, base: int, source: str, hints: Hints
) -> tuple[int, ...]:
    """The twelve hinges of the legs on `base`, in the order of `JOINTS`."""
    if hints.legs:
        return tuple(
            _named_hinge(mj_model, name, source)
            for leg in LEGS
            for name in hints.legs[leg]
        )
    legs = [chain for chain in _chains(mj_model, base) if len(chain) == 3]
    if len(legs) != 4:
        chains = _chains(mj_model, base)
        names = [mj_model.joint(joint).name for chain in chains for joint in chain]
        raise RobotError(
            f"{source}: the hinges on body {mj_model.body(base).name!r} form chains "
            f"of {[len(chain) for chain in chains]} where a quadruped has 4 legs of 3; "
            f"nest each leg's bodies as hip, thigh, calf, or name the joints of the "
            f"legs, out of {', '.join(names)}, in a TOML file beside the model",
            table_of("legs", [JOINTS[3 * leg : 3 * leg + 3] for leg in range(4)]),
        )
    return tuple(
        joint for leg in _sort_legs(mj_model, base, legs, source) for joint in leg
    )


def actuators_of(mj_model: mujoco.MjModel, joint: int) -> list[int]:
    """The actuators that act on `joint` directly."""
    on_joint = np.isin(
        mj_model.actuator_trntype,
        (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT),
    ) & (mj_model.actuator_trnid[:, 0] == joint)
    return np.flatnonzero(on_joint).tolist()


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


def stored_home(mj_model: mujoco.MjModel) -> np.ndarray:
    """Home pose [nq] of the model: the key "home", else the first one, else qpos0."""
    if not mj_model.nkey:
        return mj_model.qpos0.copy()
    home = mujoco.mj_name2id(mj_model, mujoco.mjtObj.mjOBJ_KEY, "home")
    return mj_model.key_qpos[max(home, 0)].copy()


def _named_hinge(mj_model: mujoco.MjModel, name: str, source: str) -> int:
    joint = mujoco.mj_name2id(mj_model, mujoco.mjtObj.mjOBJ_JOINT, name)
    if joint < 0 or mj_model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE:
        hinges = np.flatnonzero(mj_model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE)
        names = ", ".join(mj_model.joint(hinge).name for hinge in hinges.tolist())
        raise RobotError(
            f"{source}: [legs] names {name!r}, which is no hinge of the model; its "
            f"hinges are {names}"
        )
    return joint


def _chains(mj_model: mujoco.MjModel, base: int) -> list[list[int]]:
    """The hinges on `base`, those that hang on one another together."""
    moving = np.flatnonzero(
        np.isin(mj_model.jnt_bodyid, bodies_below(mj_model, base))
        & (mj_model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE)
    )
    # Joints are numbered depth first as well: a hinge whose body hangs on the body
    # of the hinge before it goes on with that chain, another begins a chain.
    chains: list[list[int]] = []
    for joint in moving.tolist():
        body = int(mj_model.jnt_bodyid[joint])
        if chains and body in bodies_below(
            mj_model, int(mj_model.jnt_bodyid[chains[-1][-1]])
        ):
            chains[-1].append(joint)
        else:
            chains.append([joint])
    return chains


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
        names = [[mj_model.joint(joint).name for joint in leg] for leg in legs]
        raise RobotError(
            f"{source}: the legs begin at (x, y) = {places} of the base where one is "
            "expected in each corner; turn the base so that x points forward and y "
            "left, or say which leg is which in a TOML file beside the model",
            table_of("legs", names),
        )
    return [
        corners[at]
        for at in ((True, False), (True, True), (False, False), (False, True))
    ]


def _no_foot(
    mj_model: mujoco.MjModel, leg: str, shank: int, name: str | None, source: str
) -> RobotError:
    geoms = np.flatnonzero(np.isin(mj_model.geom_bodyid, bodies_below(mj_model, shank)))
    names = [mj_model.geom(geom).name for geom in geoms.tolist()]
    offered = ", ".join(repr(name) for name in names if name) or "none with a name"
    if name is not None:
        return RobotError(
            f"{source}: [feet] says {leg} = {name!r}, which is no geom at the end of "
            f"that leg; there are {offered}"
        )
    return RobotError(
        f"{source}: body {mj_model.body(shank).name!r} at the end of a leg has no geom "
        'that collides; give it a foot to stand on, for example <geom type="sphere" '
        'size="0.02" pos="0 0 -0.2"/>, or name the geoms that are feet (here there are '
        f"{offered}) in a TOML file beside the model",
        table_of("feet", [f"{leg}_foot" for leg in LEGS]),
    )
