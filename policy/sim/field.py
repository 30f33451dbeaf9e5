"""Ground that is not flat, where a simulator runs: `data.ground.Ground` in torch.

Shapes: R rows of the grid along y, C columns along x, P any shape of points.
"""

from __future__ import annotations

import torch
from torch import Tensor

from data.ground import Ground


class Field:
    """A height field on a device; every figure is float64 and that of `Ground`."""

    def __init__(self, ground: Ground, device: torch.device) -> None:
        def constant(values: object) -> Tensor:
            return torch.tensor(values, dtype=torch.float64, device=device)

        self.device = device
        self._heights = constant(ground.heights_m)
        self._corner = constant(ground.corner_m)
        self._cell = constant(ground.cell_m)
        # How many cells along x and y: columns and rows of corners less one.
        self._cells = constant(ground.heights_m.shape[::-1]) - 1
        self.half_m = constant(ground.half_m)
        """[2] half its lengths along x and y."""
        self.middle_m = constant(ground.middle_m)
        """[2] world x and y of its middle."""

    def height_m(self, points: Tensor) -> Tensor:
        """World z [P] of the ground at `points` [P, 2]; outside, that of its edge."""
        at = torch.minimum(self._place(points).clamp(min=0), self._cells)
        # The last corner belongs to the cell before it; a diverged robot is nowhere.
        cell = torch.minimum(at.floor(), self._cells - 1).nan_to_num()
        (x, y), (along_x, along_y) = cell.long().unbind(-1), (at - cell).unbind(-1)
        near, far = self._heights[y, x], self._heights[y + 1, x + 1]
        # MuJoCo cuts every cell from its lowest to its highest corner in x and y.
        left = along_y >= along_x
        middle = torch.where(left, self._heights[y + 1, x], self._heights[y, x + 1])
        first = torch.where(left, along_y, along_x)
        second = torch.where(left, along_x, along_y)
        return near + first * (middle - near) + second * (far - middle)

    def inside(self, points: Tensor, *, margin_m: float) -> Tensor:
        """Which of `points` [P, 2] are at least `margin_m` from the edge, [P]."""
        at, margin = self._place(points), margin_m / self._cell
        return ((at >= margin) & (at <= self._cells - margin)).all(dim=-1)

    def _place(self, points: Tensor) -> Tensor:
        """Places of `points` [P, 2] on the grid, in cells along x and y."""
        return (points - self._corner) / self._cell
