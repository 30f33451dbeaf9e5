"""The end of a leg: which geom meets the ground, and where its lowest point is."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import mujoco
import numpy as np

SITE_TOLERANCE_M = 0.01
"""How far from the middle of a foot a site may lie and still stand for it."""

FLAT_TOLERANCE_M = 0.001
"""How much higher than its lowest point a point may be and belong to the sole."""


@dataclass(frozen=True, eq=False)
class Foot:
    """What was found at the end of one leg."""

    geom: int
    """The geom that meets the ground."""
    body: int
    """The body the geom belongs to."""
    point_w: np.ndarray
    """[3] m, where the site belongs in the home pose: the middle of the round end."""
    radius: float
    """m, from that point (or the site there) down to the lowest point of the foot."""
    site: int | None
    """A named site at that point, where the model has one."""


def find_foot(
    mj_model: mujoco.MjModel,
    mj_data: mujoco.MjData,
    bodies: list[int],
    name: str | None = None,
) -> Foot | None:
    """The foot among the `bodies` behind a knee; None if none of them collides.

    The geom called `name` is taken where it is given. Else a geom named "foot" or
    "toe" is preferred to a sphere, and a sphere to the rest; among equals the lowest in
    the pose of `mj_data` is taken.
    """
    below = np.flatnonzero(np.isin(mj_model.geom_bodyid, bodies)).tolist()
    if name is not None:
        geoms = [geom for geom in below if mj_model.geom(geom).name == name]
    else:
        geoms = [geom for geom in below if collides(mj_model, geom)]
    if not geoms:
        return None

    def preference(geom: int) -> tuple[bool, bool, float]:
        name = mj_model.geom(geom).name.lower()
        sphere = mj_model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_SPHERE
        point_w, radius = lowest_end(mj_model, mj_data, geom)
        named = "foot" in name or "toe" in name
        return not named, not sphere, float(point_w[2] - radius)

    geom = min(geoms, key=preference)
    point_w, radius = lowest_end(mj_model, mj_data, geom)
    site = _nearest_site(mj_model, mj_data, bodies, point_w)
    if site is not None:
        radius += float(mj_data.site_xpos[site, 2] - point_w[2])
    body = int(mj_model.geom_bodyid[geom])
    return Foot(geom, body, point_w, radius, site)


def collides(mj_model: mujoco.MjModel, geom: int) -> bool:
    """Whether anything can touch `geom`."""
    return bool(
        mj_model.geom_contype[geom]
        or mj_model.geom_conaffinity[geom]
        or geom in mj_model.pair_geom1
        or geom in mj_model.pair_geom2
    )


def lowest_end(
    mj_model: mujoco.MjModel, mj_data: mujoco.MjData, geom: int
) -> tuple[np.ndarray, float]:
    """Middle [3] m and radius in m of the round end that `geom` points downwards.

    A shape without round end gets the middle of its lowest face, edge or corner, and
    radius 0.
    """
    points_w = points_of(mj_model, mj_data, geom)
    heights = points_w[:, 2]
    match mj_model.geom_type[geom]:
        case mujoco.mjtGeom.mjGEOM_SPHERE | mujoco.mjtGeom.mjGEOM_CAPSULE:
            return points_w[np.argmin(heights)], float(mj_model.geom_size[geom, 0])
        case _:
            sole = heights < heights.min() + FLAT_TOLERANCE_M
            return points_w[sole].mean(axis=0), 0.0


def points_of(
    mj_model: mujoco.MjModel, mj_data: mujoco.MjData, geom: int
) -> np.ndarray:
    """Points [n, 3] m that `geom` ends at: middles of round ends, else corners."""
    half_length = mj_model.geom_size[geom, 1]
    match mj_model.geom_type[geom]:
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            points = np.zeros((1, 3))
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            points = np.outer((-half_length, half_length), (0.0, 0.0, 1.0))
        case mujoco.mjtGeom.mjGEOM_MESH:
            mesh = mj_model.geom_dataid[geom]
            first = mj_model.mesh_vertadr[mesh]
            points = mj_model.mesh_vert[first : first + mj_model.mesh_vertnum[mesh]]
        case _:
            middle, half = mj_model.geom_aabb[geom].reshape(2, 3)
            points = middle + half * np.array(list(product((-1, 1), repeat=3)))
    axes_w = mj_data.geom_xmat[geom].reshape(3, 3)
    return mj_data.geom_xpos[geom] + points @ axes_w.T


def _nearest_site(
    mj_model: mujoco.MjModel,
    mj_data: mujoco.MjData,
    bodies: list[int],
    point_w: np.ndarray,
) -> int | None:
    """The nearest named site on `bodies` that stands for `point_w`, if there is one."""
    sites = np.flatnonzero(np.isin(mj_model.site_bodyid, bodies)).tolist()
    named = [site for site in sites if mj_model.site(site).name]
    if not named:
        return None
    distances = np.linalg.norm(mj_data.site_xpos[named] - point_w, axis=1)
    nearest = int(np.argmin(distances))
    return named[nearest] if distances[nearest] <= SITE_TOLERANCE_M else None
