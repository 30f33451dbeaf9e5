"""Floors that run backwards under a walking robot.

Shapes: R floors of one kind, L lines on all of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from viser import BatchedGlbHandle, SceneApi

from .fast_updates import Mover
from .geometry import Rgb
from .glb import matt_glb
from .solids import box

LINE_SPACING_M = 0.25
_LINE_WIDTH_M = 0.006
_THICKNESS_M = 0.03


@dataclass(frozen=True, kw_only=True)
class Rectangle:
    """A floor; its sizes are whole numbers of lines."""

    center: tuple[float, float]
    """m"""
    size: tuple[float, float]
    """m along x and y, each a multiple of LINE_SPACING_M."""
    height_m: float = 0.0
    """Of its upper side."""


@dataclass(frozen=True)
class FloorColours:
    """What a floor looks like, each an RGB in [0, 1]."""

    plate: Rgb
    line: Rgb


LIGHT = FloorColours(plate=(0.93, 0.94, 0.95), line=(0.80, 0.82, 0.84))
DARK = FloorColours(plate=(0.30, 0.31, 0.33), line=(0.44, 0.46, 0.49))


class Floor:
    """R plates with lines; the lines scroll, each coming in where it went out."""

    def __init__(
        self, scene: SceneApi, name: str, rectangles: tuple[Rectangle, ...]
    ) -> None:
        self._name = name
        self._scene = scene
        self._grid = _Grid(rectangles)
        self._plates = self._boxes("plates", *_plates(rectangles), LIGHT.plate)
        middles = self._grid.middles(np.zeros((len(rectangles), 2)))
        self._lines = self._boxes("lines", middles, self._grid.sizes, LIGHT.line)
        self._mover = Mover(scene, self._lines.name)

    @property
    def visible(self) -> bool:
        """Whether it is drawn."""
        return self._plates.visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        self._plates.visible = self._lines.visible = visible

    def colour(self, colours: FloorColours) -> None:
        """Draw in other colours."""
        self._plates.glb_data = _cube(colours.plate)
        self._lines.glb_data = _cube(colours.line)

    def scroll(self, offsets: np.ndarray) -> None:
        """Move the lines so that ground point `offsets` [R, 2] m is in each middle."""
        self._mover.move(self._grid.middles(offsets))

    def _boxes(
        self, name: str, positions: np.ndarray, sizes: np.ndarray, rgb: Rgb
    ) -> BatchedGlbHandle:
        return self._scene.add_batched_glb(
            f"{self._name}/{name}",
            _cube(rgb),
            batched_positions=positions,
            batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (len(positions), 1)),
            batched_scales=sizes,
            lod="off",
            cast_shadow=False,
        )


class _Grid:
    """The L lines of all plates, with everything that does not scroll worked out."""

    def __init__(self, rectangles: tuple[Rectangle, ...]) -> None:
        places, sizes, axes, plates, starts, lengths = [], [], [], [], [], []
        for plate, rectangle in enumerate(rectangles):
            for axis, count in enumerate(_line_counts(rectangle)):
                size = [*rectangle.size, 0.001]
                size[axis] = _LINE_WIDTH_M
                place = [*rectangle.center, rectangle.height_m + 0.0006]
                place[axis] -= rectangle.size[axis] / 2
                places += [place] * count
                sizes += [size] * count
                axes += [axis] * count
                plates += [plate] * count
                starts += [line * LINE_SPACING_M for line in range(count)]
                lengths += [rectangle.size[axis]] * count
        self.sizes = np.array(sizes)
        """[L, 3] m"""
        self._places = np.array(places)
        self._axes, self._plates = np.array(axes), np.array(plates)
        self._starts, self._lengths = np.array(starts), np.array(lengths)
        self._lines = np.arange(len(places))

    def middles(self, offsets: np.ndarray) -> np.ndarray:
        """Middles [L, 3] float32, ground point `offsets` [R, 2] m in each middle."""
        shifts = self._starts - offsets[self._plates, self._axes]
        middles = self._places.copy()
        middles[self._lines, self._axes] += np.mod(shifts, self._lengths)
        return middles.astype(np.float32)


def _line_counts(rectangle: Rectangle) -> tuple[int, int]:
    x, y = (round(length / LINE_SPACING_M) for length in rectangle.size)
    return x, y


def _plates(rectangles: tuple[Rectangle, ...]) -> tuple[np.ndarray, np.ndarray]:
    positions = [(*r.center, r.height_m - _THICKNESS_M / 2) for r in rectangles]
    sizes = [(*r.size, _THICKNESS_M) for r in rectangles]
    return np.array(positions), np.array(sizes)


def _cube(rgb: Rgb) -> bytes:
    return matt_glb(box(np.full(3, 0.5)), rgb)
