"""Making a model independent of the files it was read from.

A checkpoint or an episode carries its robot as one text. Meshes therefore go into the
text, those that are only looked at in a coarser form; pictures are left out, and the
colour of their material stays.

Shapes: V vertices and P triangles of a mesh.
"""

from __future__ import annotations

import mujoco
import numpy as np

from .foot import collides

MAX_SEEN_VERTICES = 2000
"""A mesh that only is looked at is made coarser until it has no more vertices."""


def flatten(spec: mujoco.MjSpec) -> str:
    """The text of `spec`, which needs no other file.

    Raises:
        ValueError: MuJoCo cannot compile it.
    """
    mj_model = spec.compile()
    kept = _meshes_of_matter(spec, mj_model)
    # Read again, since a compiled mesh keeps the normals of its file.
    flat = mujoco.MjSpec.from_string(spec.to_xml())
    for mesh_id, mesh in enumerate(flat.meshes):
        if mesh.file:
            _inline_mesh(mesh, mj_model, mesh_id, exact=mesh_id in kept)
    _leave_pictures_out(flat)
    return flat.to_xml()


def _inline_mesh(
    mesh: mujoco.MjsMesh, mj_model: mujoco.MjModel, mesh_id: int, *, exact: bool
) -> None:
    vertices, faces = _as_written(mj_model, mesh_id)
    if not exact and len(vertices) > MAX_SEEN_VERTICES:
        vertices, faces = coarsen(vertices, faces, MAX_SEEN_VERTICES)
        # What is left of thin parts may enclose no volume; a shell needs none.
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    mesh.name = mj_model.mesh(mesh_id).name
    mesh.file = mesh.content_type = ""
    mesh.scale, mesh.refpos, mesh.refquat = (1, 1, 1), (0, 0, 0), (1, 0, 0, 0)
    # 10 um: digits beyond would only make the text longer.
    mesh.uservert = vertices.round(5).ravel().tolist()
    mesh.userface = faces.ravel().tolist()


def _leave_pictures_out(flat: mujoco.MjSpec) -> None:
    pictures = [
        texture for texture in flat.textures if texture.file or any(texture.cubefiles)
    ]
    names = {texture.name for texture in pictures}
    for material in flat.materials:
        if names.intersection(material.textures):
            material.textures = [""] * len(material.textures)
    for texture in pictures:
        flat.delete(texture)


def coarsen(
    vertices: np.ndarray, faces: np.ndarray, limit: int
) -> tuple[np.ndarray, np.ndarray]:
    """Merge the vertices [V, 3] that share a cell of a grid until `limit` are left.

    Returns the middles of the cells [at most `limit`, 3] and the triangles [P, 3] that
    still have three corners.
    """
    extent = np.ptp(vertices, axis=0).max()
    cells = 64
    while True:
        grid = np.floor((vertices - vertices.min(axis=0)) / extent * cells)
        _, cell, count = np.unique(
            grid, axis=0, return_inverse=True, return_counts=True
        )
        if len(count) <= limit:
            break
        cells = cells * 4 // 5
    merged = np.zeros((len(count), 3))
    np.add.at(merged, cell.ravel(), vertices)
    corners = cell.ravel()[faces]
    a, b, c = corners.T
    return merged / count[:, None], corners[(a != b) & (b != c) & (c != a)]


def _as_written(mj_model: mujoco.MjModel, mesh: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices [V, 3] in m and triangles [P, 3] in the frame of the mesh's file.

    The compiler moves every mesh into its own principal frame; this moves it back.
    """
    first, count = mj_model.mesh_vertadr[mesh], mj_model.mesh_vertnum[mesh]
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, mj_model.mesh_quat[mesh])
    vertices = mj_model.mesh_vert[first : first + count] @ rotation.reshape(3, 3).T
    first_face, face_count = mj_model.mesh_faceadr[mesh], mj_model.mesh_facenum[mesh]
    faces = mj_model.mesh_face[first_face : first_face + face_count]
    return vertices + mj_model.mesh_pos[mesh], faces


def _meshes_of_matter(spec: mujoco.MjSpec, mj_model: mujoco.MjModel) -> set[int]:
    """Meshes whose exact shape decides how the robot collides or how it weighs."""
    weighed = {body.id for body in spec.bodies if not body.explicitinertial}
    return {
        int(mj_model.geom_dataid[geom])
        for geom in np.flatnonzero(
            mj_model.geom_type == mujoco.mjtGeom.mjGEOM_MESH
        ).tolist()
        if collides(mj_model, geom) or int(mj_model.geom_bodyid[geom]) in weighed
    }
