"""Triangles for MuJoCo's shapes, with normals that keep edges sharp.

Shapes: V vertices, F triangles, P points of a profile.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

SEGMENTS = 20
"""Corners of a circle; even, so that a mirrored limb has the same vertices."""
MAX_TRIANGLES = 6000
"""A mesh with more is made coarser: a browser draws it twice, fifty times a second."""
COARSE_CELL_M = 0.006
"""Vertices closer than this become one in a mesh that is made coarser."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A triangulated shape in the frame of its geom, later of its body."""

    vertices: np.ndarray
    """[V, 3] m"""
    normals: np.ndarray
    """[V, 3] unit length"""
    faces: np.ndarray
    """[F, 3] vertex indices, counter-clockwise from outside."""

    def moved(self, position: np.ndarray, wxyz: np.ndarray) -> Solid:
        """The solid turned by `wxyz` [4], then shifted by `position` [3] m."""
        turn = rotation_matrix(wxyz)
        return Solid(
            self.vertices @ turn.T + position, self.normals @ turn.T, self.faces
        )


def solid_of_geom(mj_model: mujoco.MjModel, geom: int) -> Solid | None:
    """The shape of geom number `geom` in its own frame; None if it has no inside."""
    size = mj_model.geom_size[geom]
    kind = int(mj_model.geom_type[geom])
    types = mujoco.mjtGeom
    if kind == types.mjGEOM_SPHERE:
        return ellipsoid(np.full(3, size[0]))
    if kind == types.mjGEOM_ELLIPSOID:
        return ellipsoid(size)
    if kind == types.mjGEOM_CAPSULE:
        return capsule(size[0], size[1])
    if kind == types.mjGEOM_CYLINDER:
        return cylinder(size[0], size[1])
    if kind == types.mjGEOM_BOX:
        return box(size)
    if kind == types.mjGEOM_MESH:
        return mesh(mj_model, int(mj_model.geom_dataid[geom]))
    return None


def ellipsoid(radii: np.ndarray) -> Solid:
    """An ellipsoid with half axes `radii` [3], m."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, SEGMENTS // 2 + 1)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    unit = _lathe(circle, circle)
    return Solid(unit.vertices * radii, _unit(unit.normals / radii), unit.faces)


def capsule(radius: float, half_length: float) -> Solid:
    """A capsule along z; `half_length` from its middle to the middle of a cap, m."""
    angle = np.linspace(0, np.pi / 2, SEGMENTS // 4 + 1)
    cap = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    top = radius * cap + (0.0, half_length)
    flipped = np.array([1.0, -1.0])
    return _lathe(
        np.concatenate([top[::-1] * flipped, top]),
        np.concatenate([cap[::-1] * flipped, cap]),
    )


def cylinder(radius: float, half_length: float) -> Solid:
    """A cylinder along z, m."""
    r, h = radius, half_length
    # Each edge twice, once with the normal of each face that meets there.
    points = [(0, -h), (r, -h), (r, -h), (r, h), (r, h), (0, h)]
    normals = [(0, -1), (0, -1), (1, 0), (1, 0), (0, 1), (0, 1)]
    return _lathe(np.array(points, dtype=float), np.array(normals, dtype=float))


def box(half_size: np.ndarray) -> Solid:
    """A box with half edges `half_size` [3], m."""
    square = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], dtype=float)
    corners, normals = [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            side = np.zeros((4, 3))
            side[:, axis] = sign
            side[:, [u, v]] = square if sign > 0 else square[:, ::-1]
            corners.append(side)
            normals.append(np.tile(sign * np.eye(3)[axis], (4, 1)))
    quads = np.arange(24).reshape(6, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return Solid(np.concatenate(corners) * half_size, np.concatenate(normals), faces)


def mesh(mj_model: mujoco.MjModel, mesh_id: int) -> Solid:
    """Mesh number `mesh_id` of the model, made coarser if it is very fine."""
    vertices = _rows(mj_model.mesh_vert, mj_model.mesh_vertadr, mesh_id)
    normals = _rows(mj_model.mesh_normal, mj_model.mesh_normaladr, mesh_id)
    start, count = mj_model.mesh_faceadr[mesh_id], mj_model.mesh_facenum[mesh_id]
    faces = mj_model.mesh_face[start : start + count]
    face_normals = mj_model.mesh_facenormal[start : start + count]
    if len(faces) > MAX_TRIANGLES:
        return _coarser(vertices, faces)
    # MuJoCo numbers vertices and normals apart, a browser wants them in pairs.
    corners = np.stack([faces.ravel(), face_normals.ravel()], axis=-1)
    pairs, index = np.unique(corners, axis=0, return_inverse=True)
    return Solid(
        vertices[pairs[:, 0]], _unit(normals[pairs[:, 1]]), index.reshape(-1, 3)
    )


def rotation_matrix(wxyz: np.ndarray) -> np.ndarray:
    """The rotation [3, 3] of a quaternion."""
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, np.asarray(wxyz, dtype=float))
    return matrix.reshape(3, 3)


def _lathe(profile: np.ndarray, normals: np.ndarray) -> Solid:
    """Turn a profile [P, 2] of (radius, z), from below upwards, about z.

    Args:
        profile: Points; where two are equal, the surface has an edge.
        normals: [P, 2] unit vectors (outwards, z).
    """
    angle = np.arange(SEGMENTS) * (2 * np.pi / SEGMENTS)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    count = len(profile)

    def turned(points: np.ndarray) -> np.ndarray:
        flat = points[:, None, :1] * ring[None]
        height = np.broadcast_to(points[:, None, 1:], (count, SEGMENTS, 1))
        return np.concatenate([flat, height], axis=-1).reshape(-1, 3)

    low = np.add.outer(np.arange(count - 1) * SEGMENTS, np.arange(SEGMENTS))
    low_next = np.add.outer(
        np.arange(count - 1) * SEGMENTS, (np.arange(SEGMENTS) + 1) % SEGMENTS
    )
    high, high_next = low + SEGMENTS, low_next + SEGMENTS
    quads = np.stack([low, low_next, high_next, high], axis=-1).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return _without_slivers(Solid(turned(profile), turned(normals), faces))


def _without_slivers(solid: Solid) -> Solid:
    a, b, c = (solid.vertices[solid.faces[:, corner]] for corner in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=-1)
    return Solid(solid.vertices, solid.normals, solid.faces[area > 1e-12])


def _coarser(vertices: np.ndarray, faces: np.ndarray) -> Solid:
    """The mesh with all vertices of a small cell drawn together."""
    cells = np.round(vertices / COARSE_CELL_M).astype(np.int64)
    _, index = np.unique(cells, axis=0, return_inverse=True)
    index = index.reshape(-1)
    sums = np.zeros((index.max() + 1, 3))
    np.add.at(sums, index, vertices)
    merged = sums / np.bincount(index)[:, None]
    faces = index[faces]
    a, b, c = faces.T
    faces = np.unique(faces[(a != b) & (b != c) & (a != c)], axis=0)
    normals = np.zeros_like(merged)
    corners = merged[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    for corner in range(3):
        np.add.at(normals, faces[:, corner], across)
    return Solid(merged, _unit(normals), faces)


def _rows(values: np.ndarray, starts: np.ndarray, mesh_id: int) -> np.ndarray:
    ends = [*starts[1:], len(values)]
    return np.asarray(values[starts[mesh_id] : ends[mesh_id]], dtype=float)


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.maximum(length, 1e-12)
