"""The shapes of a robot as markers that move with its bodies.

Shapes: K bodies of the model.
"""

from __future__ import annotations

import mujoco
import numpy as np

from labeling_ui.scene.solids import mesh

from .messages import Message, header, quaternion, vector

_CUBE, _SPHERE, _CYLINDER, _TRIANGLES = 1, 2, 3, 11
_SEEN_GROUPS = 3
"""MuJoCo shows geoms of the groups 0, 1 and 2; the others are for collisions."""


def frame_names(mj_model: mujoco.MjModel, prefix: str) -> list[str]:
    """A frame for every body but the world, [K - 1]."""
    return [
        f"{prefix}/{mj_model.body(number).name or f'body{number}'}"
        for number in range(1, mj_model.nbody)
    ]


def scene(mj_model: mujoco.MjModel, prefix: str) -> Message:
    """Every visible shape of the moving bodies, or what collides if none is visible."""
    frames = ["world", *frame_names(mj_model, prefix)]
    moving = np.flatnonzero(mj_model.body_weldid[mj_model.geom_bodyid] != 0)
    seen = [
        geom
        for geom in moving
        if mj_model.geom_group[geom] < _SEEN_GROUPS and _rgba(mj_model, geom)[3] > 0
    ]
    markers: list[Message] = []
    for geom in seen or moving:
        frame = frames[mj_model.geom_bodyid[geom]]
        for shape in _shapes(mj_model, int(geom)):
            markers.append(
                _BLANK
                | shape
                | {
                    "header": header(0, frame),
                    "ns": prefix,
                    "id": len(markers),
                    "color": _colour(mj_model, int(geom)),
                }
            )
    return {"markers": markers}


_BLANK: Message = {
    "action": 0,
    "lifetime": {"sec": 0, "nanosec": 0},
    "frame_locked": True,
    "points": [],
    "colors": [],
    "texture_resource": "",
    "texture": {"header": header(0, ""), "format": "", "data": b""},
    "uv_coordinates": [],
    "text": "",
    "mesh_resource": "",
    "mesh_file": {"filename": "", "data": b""},
    "mesh_use_embedded_materials": False,
}


def _shapes(mj_model: mujoco.MjModel, geom: int) -> list[Message]:
    """A geom as one marker, or a capsule as three; nothing if it has no inside."""
    size = mj_model.geom_size[geom]
    position, wxyz = mj_model.geom_pos[geom], mj_model.geom_quat[geom]
    types = mujoco.mjtGeom
    match int(mj_model.geom_type[geom]):
        case types.mjGEOM_SPHERE:
            return [_shape(_SPHERE, position, wxyz, np.full(3, 2 * size[0]))]
        case types.mjGEOM_ELLIPSOID:
            return [_shape(_SPHERE, position, wxyz, 2 * size)]
        case types.mjGEOM_BOX:
            return [_shape(_CUBE, position, wxyz, 2 * size)]
        case types.mjGEOM_CYLINDER:
            scale = 2 * np.array([size[0], size[0], size[1]])
            return [_shape(_CYLINDER, position, wxyz, scale)]
        case types.mjGEOM_CAPSULE:
            turn = np.empty(9)
            mujoco.mju_quat2Mat(turn, wxyz)
            end = turn.reshape(3, 3)[:, 2] * size[1]
            ball = np.full(3, 2 * size[0])
            scale = 2 * np.array([size[0], size[0], size[1]])
            return [
                _shape(_CYLINDER, position, wxyz, scale),
                _shape(_SPHERE, position + end, wxyz, ball),
                _shape(_SPHERE, position - end, wxyz, ball),
            ]
        case types.mjGEOM_MESH:
            solid = mesh(mj_model, int(mj_model.geom_dataid[geom]))
            corners = solid.vertices[solid.faces.ravel()]
            triangles = _shape(_TRIANGLES, position, wxyz, np.ones(3))
            return [triangles | {"points": [vector(corner) for corner in corners]}]
    return []


def _shape(
    kind: int, position: np.ndarray, wxyz: np.ndarray, scale: np.ndarray
) -> Message:
    pose = {"position": vector(position), "orientation": quaternion(wxyz)}
    return {"type": kind, "pose": pose, "scale": vector(scale)}


def _rgba(mj_model: mujoco.MjModel, geom: int | np.integer) -> np.ndarray:
    material = mj_model.geom_matid[geom]
    own = mj_model.geom_rgba[geom]
    # What MuJoCo gives a geom without a colour, which then has that of its material.
    if material >= 0 and np.allclose(own, (0.5, 0.5, 0.5, 1.0)):
        return mj_model.mat_rgba[material]
    return own


def _colour(mj_model: mujoco.MjModel, geom: int) -> Message:
    return dict(zip("rgba", map(float, _rgba(mj_model, geom)), strict=True))
