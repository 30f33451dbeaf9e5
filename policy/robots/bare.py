"""The model that is simulated: without what is only looked at.

A robot that is nice to see has a hundred geoms that touch nothing, and MuJoCo places
each of them in every physics step.
"""

from __future__ import annotations

import mujoco
import numpy as np

_BODY = ("mass", "inertia", "ipos", "iquat", "pos", "quat", "invweight0")
_GEOM = (
    *("type", "bodyid", "size", "pos", "quat", "contype", "conaffinity", "condim"),
    *("priority", "friction", "solmix", "solref", "solimp", "margin", "gap"),
)


def bare_model(mjcf: str, mj_model: mujoco.MjModel) -> mujoco.MjModel:
    """`mj_model`, which `mjcf` compiles to, without its visual geoms.

    It moves alike to the last bit. Bodies, joints, sites, actuators and sensors keep
    their ids; geoms do not. A model that would move otherwise is given back as it is.
    """
    spec = mujoco.MjSpec.from_string(mjcf)
    spec.compiler.discardvisual = True
    bare = spec.compile()
    return bare if _moves_alike(bare, mj_model) else mj_model


def _moves_alike(bare: mujoco.MjModel, mj_model: mujoco.MjModel) -> bool:
    sizes = ("nq", "nv", "nbody", "nsite", "nu", "nsensordata", "npair", "nexclude")
    if any(getattr(bare, size) != getattr(mj_model, size) for size in sizes):
        return False
    fields = [f"body_{name}" for name in _BODY] + ["dof_invweight0", "sensor_adr"]
    if not all(_equal(getattr(bare, f), getattr(mj_model, f)) for f in fields):
        return False
    here, there = _colliding(bare), _colliding(mj_model)
    return all(
        _equal(
            getattr(bare, f"geom_{name}")[here],
            getattr(mj_model, f"geom_{name}")[there],
        )
        for name in _GEOM
    )


def _colliding(mj_model: mujoco.MjModel) -> np.ndarray:
    """Ids of the geoms that may touch others, in their order."""
    collides = (mj_model.geom_contype | mj_model.geom_conaffinity) != 0
    collides[mj_model.pair_geom1] = collides[mj_model.pair_geom2] = True
    return np.flatnonzero(collides)


def _equal(left: np.ndarray, right: np.ndarray) -> bool:
    return left.shape == right.shape and bool((left == right).all())
