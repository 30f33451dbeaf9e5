"""Preparing the parts a model has beside or instead of plain legs."""

from __future__ import annotations

import mujoco
import numpy as np

from data.features import LEGS

from .anatomy import Skeleton, bodies_below
from .foot import collides
from .hints import RobotError


def freeze_other_joints(spec: mujoco.MjSpec, skeleton: Skeleton) -> str | None:
    """Take away the joints that belong to no leg (an arm, a tail); tells which.

    What hung on them stays where the file draws it.
    """
    mj_model = skeleton.mj_model
    others = [
        joint
        for joint in range(mj_model.njnt)
        if joint not in skeleton.joints
        and mj_model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE
    ]
    if not others:
        return None
    joints = {joint.id: joint for joint in spec.joints}
    names = [joints[other].name for other in others]
    gone = np.concatenate([_qpos_of(mj_model, other) for other in others])
    poses = [np.delete(np.asarray(key.qpos), gone).tolist() for key in spec.keys]
    names_of_keys = [key.name for key in spec.keys]
    for key in list(spec.keys):
        spec.delete(key)
    for part in (*spec.actuators, *spec.sensors):
        if (part.target if hasattr(part, "target") else part.objname) in names:
            spec.delete(part)
    for other in others:
        spec.delete(joints[other])
    for name, pose in zip(names_of_keys, poses, strict=True):
        spec.add_key(name=name, qpos=pose)
    return f"joints of no leg were fixed: {', '.join(names)}"


def make_feet_collide(spec: mujoco.MjSpec, skeleton: Skeleton) -> str | None:
    """Let feet that were named, but only are drawn, touch the floor; tells which."""
    feet = skeleton.hints.feet
    if not feet:
        return None
    made = []
    for leg, joint in zip(LEGS, skeleton.joints[2::3], strict=True):
        mj_model = skeleton.mj_model
        shank = int(mj_model.jnt_bodyid[joint])
        geom = mujoco.mj_name2id(mj_model, mujoco.mjtObj.mjOBJ_GEOM, feet[leg])
        if geom < 0 or mj_model.geom_bodyid[geom] not in bodies_below(mj_model, shank):
            names = [
                mj_model.geom(index).name
                for index in range(mj_model.ngeom)
                if mj_model.geom_bodyid[index] in bodies_below(mj_model, shank)
            ]
            offered = ", ".join(name for name in names if name) or "none with a name"
            raise RobotError(
                f"{skeleton.source}: [feet] says {leg} = {feet[leg]!r}, which is no "
                f"geom behind the knee of that leg; there are {offered}"
            )
        if not collides(mj_model, geom):
            drawn = spec.geom(feet[leg])
            drawn.contype, drawn.conaffinity = 0, 1
            made.append(feet[leg])
    return f"geoms touch the floor as feet: {', '.join(made)}" if made else None


def _qpos_of(mj_model: mujoco.MjModel, joint: int) -> np.ndarray:
    """Where the positions of `joint` are in qpos."""
    width = {mujoco.mjtJoint.mjJNT_BALL: 4}.get(int(mj_model.jnt_type[joint]), 1)
    return mj_model.jnt_qposadr[joint] + np.arange(width)
