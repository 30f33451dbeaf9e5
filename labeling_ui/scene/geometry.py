"""From the MJCF text of an episode to what is drawn, and from states to poses.

Shapes: nq positions of the model, S states of a clip, K bodies that share one mesh,
I instances, which are the bodies of all meshes one after the other.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property, lru_cache

import mujoco
import numpy as np

from data.course_marks import BAR_PREFIX
from data.errors import EpisodeError
from data.ground import Ground

from .solids import Solid, solid_of_geom

Rgb = tuple[float, float, float]
"""Red, green, blue as a screen shows them (sRGB), each in [0, 1]."""

_SEEN_GROUPS = 3
"""MuJoCo shows geoms of the groups 0, 1 and 2; the others are for collisions."""
_FOOTPRINT_M = 0.25
"""No foot is farther than this from the base along x or y, while it stands."""
_NO_COLOUR = (0.5, 0.5, 0.5, 1.0)
"""What MuJoCo gives a geom without a colour, which then has that of its material."""
_HALF_TURNS = np.array([(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)])
"""wxyz of nothing and of half a turn about x, y and z."""


@dataclass(frozen=True, eq=False)
class Piece:
    """A solid in the frame of its body, and its colour."""

    solid: Solid
    rgb: Rgb


@dataclass(frozen=True, eq=False)
class BodyMesh:
    """A mesh that one or more bodies are drawn with."""

    pieces: tuple[Piece, ...]
    body_ids: tuple[int, ...]
    """[K] bodies of the model."""
    body_wxyz: np.ndarray
    """[K, 4] how the mesh is turned in the frame of each body."""


@dataclass(frozen=True, eq=False)
class RobotGeometry:
    """A robot as it is drawn; the floor is not part of it."""

    key: str
    """A text that is the same for equal MJCF texts."""
    mj_model: mujoco.MjModel
    meshes: tuple[BodyMesh, ...]

    @cached_property
    def robots(self) -> int:
        """How many there are: bodies that go where they like."""
        return int((self.mj_model.jnt_type == mujoco.mjtJoint.mjJNT_FREE).sum())

    @cached_property
    def ground(self) -> Ground | None:
        """The ground under the robot; None is the plane z = 0."""
        mj_model = self.mj_model
        shown = np.flatnonzero(mj_model.geom_type == mujoco.mjtGeom.mjGEOM_HFIELD)
        if not len(shown):
            return None
        field = int(mj_model.geom_dataid[shown[0]])
        shape = (mj_model.hfield_nrow[field], mj_model.hfield_ncol[field])
        first = int(mj_model.hfield_adr[field])
        return Ground.of_hfield(
            mj_model.hfield_data[first : first + shape[0] * shape[1]].reshape(shape),
            mj_model.hfield_size[field],
            mj_model.geom_pos[shown[0]],
        )

    def floor_m(self, places: np.ndarray) -> np.ndarray:
        """World z [P] at which an even floor hides no foot of it at `places` [P, 2].

        Floors are drawn even: on hills the feet are drawn as high above the floor as
        they are above the lowest ground around the robot.
        """
        ground = self.ground
        if ground is None:
            return np.zeros(places.shape[:-1])
        return ground.level_m(places, reach_m=_FOOTPRINT_M)

    @property
    def instance_body_ids(self) -> np.ndarray:
        """[I] the body of every instance."""
        return np.concatenate([mesh.body_ids for mesh in self.meshes])

    @property
    def instance_slices(self) -> tuple[slice, ...]:
        """The instances of every mesh."""
        ends = np.cumsum([len(mesh.body_ids) for mesh in self.meshes])
        starts = [0, *ends[:-1]]
        return tuple(slice(a, b) for a, b in zip(starts, ends, strict=True))


@lru_cache(maxsize=8)
def robot_geometry(mjcf: str) -> RobotGeometry:
    """What to draw for a robot.

    Raises:
        EpisodeError: MuJoCo cannot compile the text, or nothing of it can be seen.
    """
    try:
        mj_model = mujoco.MjModel.from_xml_string(mjcf)
    except ValueError as error:
        raise EpisodeError(
            f"the robot in the episode does not compile ({error}); record it again"
        ) from None
    key = hashlib.sha256(mjcf.encode()).hexdigest()[:16]
    bodies = _pieces_of_bodies(mj_model)
    if not bodies:
        raise EpisodeError(
            f"robot {key} has no shape that can be drawn; give its bodies geoms"
        )
    return RobotGeometry(key, mj_model, _shared_meshes(bodies))


def instance_poses(
    geometry: RobotGeometry, qpos: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where every instance is in the states `qpos` [S, nq].

    Returns:
        Positions [S, I, 3] in m and attitudes [S, I, 4] wxyz, world frame, float32.
    """
    mj_model = geometry.mj_model
    mj_data = mujoco.MjData(mj_model)
    ids = geometry.instance_body_ids
    positions = np.empty((len(qpos), len(ids), 3), dtype=np.float32)
    body_wxyz = np.empty((len(qpos), len(ids), 4))
    for row, state in enumerate(qpos):
        mj_data.qpos[:] = state
        mujoco.mj_kinematics(mj_model, mj_data)
        positions[row] = mj_data.xpos[ids]
        body_wxyz[row] = mj_data.xquat[ids]
    turns = np.concatenate([mesh.body_wxyz for mesh in geometry.meshes])
    return positions, multiply_wxyz(body_wxyz, turns).astype(np.float32)


def multiply_wxyz(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """The quaternions [..., 4] that turn by `right` first, then by `left`."""
    a, b, c, d = np.moveaxis(left, -1, 0)
    e, f, g, h = np.moveaxis(right, -1, 0)
    return np.stack(
        [
            a * e - b * f - c * g - d * h,
            a * f + b * e + c * h - d * g,
            a * g - b * h + c * e + d * f,
            a * h + b * g - c * f + d * e,
        ],
        axis=-1,
    )


def linear_rgb(rgb: Rgb) -> np.ndarray:
    """A colour as shares of linear light [3], as renderers count."""
    shown = np.array(rgb)
    return np.where(shown > 0.04045, ((shown + 0.055) / 1.055) ** 2.4, shown / 12.92)


def _pieces_of_bodies(mj_model: mujoco.MjModel) -> dict[int, tuple[Piece, ...]]:
    """What is seen of every moving body, or what collides if nothing is to be seen."""
    of_body = mj_model.geom_bodyid
    moving = np.flatnonzero((mj_model.body_weldid[of_body] != 0) | _is_bar(mj_model))
    solid = moving[mj_model.geom_rgba[moving, 3] > 0]
    seen = solid[mj_model.geom_group[solid] < _SEEN_GROUPS]
    bodies: dict[int, tuple[Piece, ...]] = {}
    for geom in seen if len(seen) else solid:
        shape = solid_of_geom(mj_model, int(geom))
        if shape is None:
            continue
        placed = shape.moved(mj_model.geom_pos[geom], mj_model.geom_quat[geom])
        body = int(mj_model.geom_bodyid[geom])
        piece = Piece(placed, _colour(mj_model, int(geom)))
        bodies[body] = (*bodies.get(body, ()), piece)
    return bodies


def _is_bar(mj_model: mujoco.MjModel) -> np.ndarray:
    """Which geoms [n] are bars of a course, which robots are to pass below."""
    bars = [
        body
        for body in range(mj_model.nbody)
        if mj_model.body(body).name.startswith(BAR_PREFIX)
    ]
    return np.isin(mj_model.geom_bodyid, bars)


def _colour(mj_model: mujoco.MjModel, geom: int) -> Rgb:
    rgba = mj_model.geom_rgba[geom]
    material = int(mj_model.geom_matid[geom])
    if material >= 0 and np.allclose(rgba, _NO_COLOUR):
        rgba = mj_model.mat_rgba[material]
    red, green, blue = (round(float(channel), 4) for channel in rgba[:3])
    return red, green, blue


def _shared_meshes(bodies: dict[int, tuple[Piece, ...]]) -> tuple[BodyMesh, ...]:
    """One mesh for all bodies that look alike, also after half a turn.

    Left and right hips are mirror images, but mostly of symmetric shapes, so that a
    half turn makes one of the other.
    """
    found: list[BodyMesh] = []
    for body, pieces in bodies.items():
        for index, mesh in enumerate(found):
            turn = _matching_turn(mesh.pieces, pieces)
            if turn is not None:
                turns = np.concatenate([mesh.body_wxyz, turn[None]])
                found[index] = BodyMesh(mesh.pieces, (*mesh.body_ids, body), turns)
                break
        else:
            found.append(BodyMesh(pieces, (body,), _HALF_TURNS[:1].astype(float)))
    return tuple(found)


def _matching_turn(
    mesh: tuple[Piece, ...], pieces: tuple[Piece, ...]
) -> np.ndarray | None:
    """The turn wxyz [4] that makes `mesh` look like `pieces`; None if none does."""
    if sorted(p.rgb for p in mesh) != sorted(p.rgb for p in pieces):
        return None
    wanted = _fingerprint(pieces, _HALF_TURNS[0])
    for turn in _HALF_TURNS.astype(float):
        if _fingerprint(mesh, turn) == wanted:
            return turn
    return None


def _fingerprint(pieces: tuple[Piece, ...], turn: np.ndarray) -> frozenset[bytes]:
    """A text that is the same for the same points in the same colours, in any order."""
    at = np.zeros(3)
    marks = set()
    for piece in pieces:
        points = np.round(piece.solid.moved(at, turn).vertices, 5) + 0.0
        ordered = np.unique(points, axis=0)
        marks.add(ordered.tobytes() + repr(piece.rgb).encode())
    return frozenset(marks)
