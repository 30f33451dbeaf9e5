"""An endless floor that is drawn as few tiles.

MuJoCo draws one as 200 x 200 tiles and lights every corner, which without a graphics
card takes a quarter of the time of a film. Where all lamps shine in parallel, a floor
of fewer tiles looks the same.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np

from .flat_shadow import flat_floor

_TILES = 48
"""Along each side: about 2 m each, for what shines a little."""
_PARALLEL = int(mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)


@dataclass(frozen=True, kw_only=True)
class EndlessFloor:
    """The floor, a geom of a model."""

    geom: int
    half_m: float
    """From its middle to where it is no longer seen."""

    @contextmanager
    def of_few_tiles(self, mj_model: mujoco.MjModel) -> Iterator[None]:
        """The floor has an end, and few tiles, while a context is made that draws it.

        Afterwards it is endless again: it follows the camera, and has its haze.
        """
        size = mj_model.geom_size[self.geom].copy()
        mj_model.geom_size[self.geom] = (
            self.half_m,
            self.half_m,
            2 * self.half_m / _TILES,
        )
        try:
            yield
        finally:
            mj_model.geom_size[self.geom] = size

    def lay(self, scene: mujoco.MjvScene) -> None:
        """Give the floor of a new scene its texture: a metre of it is now a share."""
        for number in range(scene.ngeom):
            part = scene.geoms[number]
            if part.objtype == mujoco.mjtObj.mjOBJ_GEOM and part.objid == self.geom:
                part.texrepeat[:] = self.half_m * np.asarray(part.texrepeat)
                return


def endless_floor(mj_model: mujoco.MjModel) -> EndlessFloor | None:
    """The floor that may be drawn so; None where it would look different."""
    if not flat_floor(mj_model):
        return None
    geom = int(np.flatnonzero(mj_model.geom_bodyid == 0)[0])
    ends = mj_model.geom_size[geom, :2].any()
    if ends or (mj_model.light_type != _PARALLEL).any():
        return None
    if not _by_metres(mj_model, int(mj_model.geom_matid[geom])):
        return None
    half_m = float(mj_model.vis.map.zfar * mj_model.stat.extent)
    return EndlessFloor(geom=geom, half_m=half_m)


def _by_metres(mj_model: mujoco.MjModel, material: int) -> bool:
    """Whether its texture, if any, has a size of its own."""
    return material < 0 or bool(
        mj_model.mat_texuniform[material] or (mj_model.mat_texid[material] < 0).all()
    )
