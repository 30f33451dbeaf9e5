"""Ground that is not flat: a grid of heights with planes between them.

Shapes: R rows of the grid along y, C columns along x, P any shape of points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Ground:
    """A height field as MuJoCo makes triangles of it."""

    heights_m: np.ndarray
    """[R, C] z of the grid's points, world frame."""
    corner_m: tuple[float, float]
    """World x and y of the point [0, 0]."""
    cell_m: tuple[float, float]
    """Distance of neighbours along x and y."""

    def __post_init__(self) -> None:
        if self.heights_m.ndim != 2 or min(self.heights_m.shape) < 2:
            raise ValueError(
                f"ground needs a grid of at least 2 x 2 heights, got shape "
                f"{self.heights_m.shape}"
            )
        self.heights_m.setflags(write=False)

    @staticmethod
    def of_hfield(values: np.ndarray, size: np.ndarray, origin: np.ndarray) -> Ground:
        """The ground of MuJoCo's field `values` [R, C] in [0, 1].

        Args:
            values: `hfield_data` of the field, row by row.
            size: `hfield_size` [4]: half lengths along x and y, height, thickness.
            origin: World position [3] of the geom that shows it, which is not turned.
        """
        rows, columns = values.shape
        return Ground(
            heights_m=origin[2] + size[2] * values.astype(np.float64),
            corner_m=(float(origin[0] - size[0]), float(origin[1] - size[1])),
            cell_m=(2 * size[0] / (columns - 1), 2 * size[1] / (rows - 1)),
        )

    def height_m(self, points: np.ndarray) -> np.ndarray:
        """World z [P] of the ground at `points` [P, 2]; outside, that of its edge."""
        rows, columns = self.heights_m.shape
        at_x, at_y = self._cells(points)
        at_x, at_y = at_x.clip(0, columns - 1), at_y.clip(0, rows - 1)
        x = np.minimum(at_x.astype(np.intp), columns - 2)
        y = np.minimum(at_y.astype(np.intp), rows - 2)
        along_x, along_y = at_x - x, at_y - y
        heights = self.heights_m
        near, far = heights[y, x], heights[y + 1, x + 1]
        # MuJoCo cuts every cell from its lowest to its highest corner in x and y.
        left = along_y >= along_x
        middle = np.where(left, heights[y + 1, x], heights[y, x + 1])
        first = np.where(left, along_y, along_x)
        second = np.where(left, along_x, along_y)
        return near + first * (middle - near) + second * (far - middle)

    def inside(self, points: np.ndarray, *, margin_m: float) -> np.ndarray:
        """Which of `points` [P, 2] are at least `margin_m` from the edge, [P]."""
        rows, columns = self.heights_m.shape
        at_x, at_y = self._cells(points)
        x_cells, y_cells = (margin_m / cell for cell in self.cell_m)
        return (
            (at_x >= x_cells)
            & (at_x <= columns - 1 - x_cells)
            & (at_y >= y_cells)
            & (at_y <= rows - 1 - y_cells)
        )

    def level_m(self, points: np.ndarray, *, reach_m: float) -> np.ndarray:
        """The lowest ground [P] within `reach_m` of `points` [P, 2], along x and y."""
        steps = np.linspace(-reach_m, reach_m, 5)
        around = np.stack(np.meshgrid(steps, steps), axis=-1)
        heights = self.height_m(points[..., None, None, :] + around)
        return heights.min(axis=(-2, -1))

    @property
    def middle_m(self) -> np.ndarray:
        """World x and y [2] of its middle."""
        return np.array(self.corner_m) + self.half_m

    @property
    def half_m(self) -> np.ndarray:
        """Half its lengths [2] along x and y."""
        return (np.array(self.heights_m.shape[::-1]) - 1) * self.cell_m / 2

    def _cells(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places of `points` [P, 2] on the grid, in cells along x and y."""
        x, y = np.moveaxis((points - self.corner_m) / self.cell_m, -1, 0)
        return x, y
