"""The shadow of a robot on a flat floor, laid there as flattened copies of its parts.

MuJoCo draws a scene three times for the shadow of one lamp, which without a graphics
card takes more than half of the time of a film.
"""

from __future__ import annotations

import mujoco
import numpy as np

_ABOVE_M = 0.002
_SHADOW = np.array([0.33, 0.36, 0.4, 1.0], np.float32)
"""Opaque: parts overlap, and would be darker where they do."""
_FALLS = np.array([[1.0, 0.0, 0.1], [0.0, 1.0, -0.1], [0.0, 0.0, 1e-3]])
"""Where light that comes from a little aside takes a point, as x, y and height."""
_MOVES = int(mujoco.mjtCatBit.mjCAT_DYNAMIC)


def flat_floor(mj_model: mujoco.MjModel) -> bool:
    """Whether all that stands still is one level plane at height 0."""
    still = np.flatnonzero(mj_model.geom_bodyid == 0)
    return len(still) == 1 and bool(
        mj_model.geom_type[still[0]] == mujoco.mjtGeom.mjGEOM_PLANE
        and mj_model.geom_pos[still[0], 2] == 0
        and np.array_equal(mj_model.geom_quat[still[0]], [1, 0, 0, 0])
    )


def cast_shadows(scene: mujoco.MjvScene) -> None:
    """Add a flattened copy of everything in the scene that moves."""
    for number in range(min(scene.ngeom, scene.maxgeom // 2)):
        part = scene.geoms[number]
        if part.category != _MOVES:
            continue
        copy = scene.geoms[scene.ngeom]
        lies = _FALLS @ part.pos
        lies[2] += _ABOVE_M
        mujoco.mjv_initGeom(
            copy, part.type, part.size, lies, (_FALLS @ part.mat).ravel(), _SHADOW
        )
        copy.dataid, copy.specular = part.dataid, 0.0
        scene.ngeom += 1
