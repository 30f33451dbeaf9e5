"""Legs that touch the ground, for robots that lie on it."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from data.features import LEGS

from .additions import PREFIX
from .foot import collides

_FREE_OF_FOOT = 0.85
"""Share of a shank that is made solid: what is below is the foot's own."""
_THIN_M = 0.012


@dataclass(frozen=True, eq=False)
class _Link:
    """A thigh or a shank that nothing touches yet."""

    body: int
    ends_b: np.ndarray
    """[6] m, both ends in the frame of the body"""
    foot: int
    """The geom of the same leg's foot."""


def make_legs_solid(
    spec: mujoco.MjSpec,
    mj_model: mujoco.MjModel,
    home_qpos: np.ndarray,
    joints: list[int],
) -> bool:
    """Give thighs and shanks a shape that collides as their foot does.

    A walk needs no more than feet and trunk, and a model may have no more.

    Args:
        spec: Changed in place; `mj_model` was compiled of it.
        mj_model: The complete model of a quadruped.
        home_qpos: Home pose [nq].
        joints: The twelve joints, hip, thigh and calf of every leg.

    Returns:
        Whether there was anything to do.
    """
    mj_data = mujoco.MjData(mj_model)
    mj_data.qpos[:] = home_qpos
    mujoco.mj_kinematics(mj_model, mj_data)
    bodies = {body.id: body for body in spec.bodies}
    links = [
        link
        for leg in range(len(LEGS))
        for link in _links(mj_model, mj_data, leg, joints[3 * leg : 3 * leg + 3])
    ]
    for link in links:
        thick_m = max(0.6 * float(mj_model.geom_size[link.foot, 0]), _THIN_M)
        bodies[link.body].add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=link.ends_b,
            size=[min(thick_m, 3 * _THIN_M), 0, 0],
            contype=int(mj_model.geom_contype[link.foot]),
            conaffinity=int(mj_model.geom_conaffinity[link.foot]),
            friction=mj_model.geom_friction[link.foot],
            mass=0,
            group=3,
        )
    return bool(links)


def _links(
    mj_model: mujoco.MjModel, mj_data: mujoco.MjData, leg: int, joints: list[int]
) -> list[_Link]:
    """Geoms of a leg's thigh and shank that nothing but their foot touches."""
    _, thigh, knee = joints
    foot = int(mj_model.sensor(f"{PREFIX}contact_{LEGS[leg]}").objid[0])
    knee_w, foot_w = mj_data.xanchor[knee], mj_data.geom_xpos[foot]
    reach_w = knee_w + _FREE_OF_FOOT * (foot_w - knee_w)
    links = []
    for joint, ends_w in (
        (thigh, (mj_data.xanchor[thigh], knee_w)),
        (knee, (knee_w, reach_w)),
    ):
        body = int(mj_model.jnt_bodyid[joint])
        others = set(np.flatnonzero(mj_model.geom_bodyid == body).tolist()) - {foot}
        if not any(collides(mj_model, geom) for geom in others):
            rotation_w = mj_data.xmat[body].reshape(3, 3)
            ends_b = (np.array(ends_w) - mj_data.xpos[body]) @ rotation_w
            links.append(_Link(body, ends_b.ravel(), foot))
    return links
