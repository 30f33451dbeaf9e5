"""Marks on the ground before a robot: the way it was told to go.

Shapes: W marks of a way.
"""

from __future__ import annotations

import numpy as np
from viser import SceneApi

from .fast_updates import Mover
from .geometry import Rgb
from .glb import matt_glb
from .obedience import HIDDEN_M, MARKS
from .solids import Solid

_RGB: Rgb = (0.06, 0.50, 0.34)
_LENGTH_M, _WIDTH_M, _HEIGHT_M = 0.045, 0.09, 0.004


class WayMarks:
    """Arrowheads of one robot."""

    def __init__(self, scene: SceneApi, name: str) -> None:
        tip, back = (_LENGTH_M, 0.0), -_LENGTH_M
        corners = [tip, (back, _WIDTH_M / 2), (back / 3, 0.0), (back, -_WIDTH_M / 2)]
        arrow = Solid(
            vertices=np.array([(x, y, _HEIGHT_M) for x, y in corners]),
            normals=np.tile([0.0, 0.0, 1.0], (len(corners), 1)),
            faces=np.array([[0, 1, 2], [0, 2, 3]]),
        )
        self._handle = scene.add_batched_glb(
            f"/way_{name}",
            matt_glb(arrow, _RGB),
            batched_positions=np.full((MARKS, 3), HIDDEN_M),
            batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (MARKS, 1)),
            lod="off",
            cast_shadow=False,
        )
        self._mover = Mover(scene, self._handle.name)

    def show(self, visible: bool) -> None:
        """Draw them or not."""
        self._handle.visible = visible

    def move(self, positions: np.ndarray, wxyzs: np.ndarray) -> None:
        """Put them at `positions` [W, 3] m, turned by `wxyzs` [W, 4]; float32."""
        self._mover.move(positions, wxyzs)
