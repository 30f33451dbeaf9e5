"""The floor of a robot: one plane at z = 0, whatever came with the model.

What the environment measures is measured from there; other ground is chosen with
`EnvCfg.terrain`.
"""

from __future__ import annotations

import mujoco
import numpy as np

from data.ground import Ground

from .anatomy import Skeleton, bodies_below, find_base
from .foot import collides

FLOOR_NAME = "gaitpref_floor"

TERRAIN_NAME = "gaitpref_terrain"
"""Name of the height field that `policy.env.terrain` puts into the floor's place."""

_LEVEL = 1e-6


def ensure_floor(spec: mujoco.MjSpec, skeleton: Skeleton) -> str | None:
    """Give `spec` its floor; tells what was done.

    `skeleton` is of what `spec` compiles to.
    """
    mj_model = skeleton.mj_model
    robot = bodies_below(mj_model, find_base(mj_model, skeleton.source))
    ground = [
        geom
        for geom in range(mj_model.ngeom)
        if mj_model.geom_bodyid[geom] not in robot and collides(mj_model, geom)
    ]
    feet = [foot.geom for foot in skeleton.feet(mj_model.qpos0)]
    if ground and all(_is_floor(mj_model, geom, feet) for geom in ground):
        return None
    geoms = {geom.id: geom for geom in spec.geoms}
    names = [geoms[geom].name for geom in ground if geoms[geom].name]
    for geom in ground:
        spec.delete(geoms[geom])
    for hfield in list(spec.hfields):
        spec.delete(hfield)
    forget(spec, names[1:])
    mine = [g for g in range(mj_model.ngeom) if mj_model.geom_bodyid[g] in robot]
    bits = np.bitwise_or.reduce(
        mj_model.geom_contype[mine] | mj_model.geom_conaffinity[mine]
    )
    spec.worldbody.add_geom(
        # What the model says of its ground now holds for the floor.
        name=names[0] if names else FLOOR_NAME,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0, 0, 0.05],
        friction=[0.8, 0.005, 0.0001],
        rgba=[0.66, 0.69, 0.72, 1],
        contype=int(bits),
        conaffinity=int(bits),
    )
    if not ground:
        return "the model has no ground: a floor at z = 0 was added"
    return f"{len(ground)} geoms of the ground were replaced by a floor at z = 0"


def ground_of(mj_model: mujoco.MjModel) -> Ground | None:
    """The height field that stands for the floor of `mj_model`; None for a plane."""
    field = mujoco.mj_name2id(mj_model, mujoco.mjtObj.mjOBJ_HFIELD, TERRAIN_NAME)
    if field < 0:
        return None
    shows = (mj_model.geom_type == mujoco.mjtGeom.mjGEOM_HFIELD) & (
        mj_model.geom_dataid == field
    )
    first = mj_model.hfield_adr[field]
    shape = (mj_model.hfield_nrow[field], mj_model.hfield_ncol[field])
    return Ground.of_hfield(
        mj_model.hfield_data[first : first + shape[0] * shape[1]].reshape(shape),
        mj_model.hfield_size[field],
        mj_model.geom_pos[np.flatnonzero(shows)[0]],
    )


def forget(spec: mujoco.MjSpec, geoms: list[str]) -> None:
    """Take away what names one of `geoms`, which are gone."""
    for pair in list(spec.pairs):
        if {pair.geomname1, pair.geomname2} & set(geoms):
            spec.delete(pair)
    for sensor in list(spec.sensors):
        if {sensor.objname, sensor.refname} & set(geoms):
            spec.delete(sensor)


def _is_floor(mj_model: mujoco.MjModel, geom: int, feet: list[int]) -> bool:
    """Whether `geom` is the plane z = 0, and the geoms `feet` can stand on it."""
    mj_data = mujoco.MjData(mj_model)
    mujoco.mj_kinematics(mj_model, mj_data)
    up_w = mj_data.geom_xmat[geom].reshape(3, 3)[:, 2]
    return bool(
        mj_model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE
        and up_w[2] > 1 - _LEVEL
        and abs(mj_data.geom_xpos[geom, 2]) < _LEVEL
        and all(_touch(mj_model, geom, foot) for foot in feet)
    )


def _touch(mj_model: mujoco.MjModel, one: int, other: int) -> bool:
    """Whether the two geoms can be in contact."""
    types, affinities = mj_model.geom_contype, mj_model.geom_conaffinity
    pairs = np.stack([mj_model.pair_geom1, mj_model.pair_geom2], axis=1)
    return bool(
        types[one] & affinities[other]
        or types[other] & affinities[one]
        or (np.sort(pairs, axis=1) == sorted((one, other))).all(axis=1).any()
    )
