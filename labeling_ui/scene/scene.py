"""What one visitor sees: robot A to the left, robot B to the right, one camera.

All handles belong to one client, are made once and then only moved.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import viser
from viser import BatchedGlbHandle, SceneApi

from .fast_updates import Mover
from .floor import DARK, LIGHT, Floor, Rectangle
from .geometry import Rgb, RobotGeometry
from .glb import LEFT_RGB, RIGHT_RGB, tinted_glbs
from .way_marks import WayMarks

View = Literal["treadmill", "lanes"]
"""`treadmill`: side by side, seen from the side, each on its own floor. `lanes`: one
floor, the same start line, so that the faster one gets ahead."""

NAMES = ("A", "B")
COLOURS = (LEFT_RGB, RIGHT_RGB)
_PLATES = (
    Rectangle(center=(-0.60, 0.0), size=(1.0, 0.75)),
    Rectangle(center=(0.60, 0.0), size=(1.0, 0.75)),
)
_SHELVES = (
    Rectangle(center=(0.0, 0.0), size=(1.0, 0.75), height_m=0.66),
    Rectangle(center=(0.0, 0.0), size=(1.0, 0.75)),
)
"""One above the other, where a picture is too narrow for both side by side."""
_ONE_PLATE = (Rectangle(center=(0.0, 0.0), size=(1.5, 1.0)),)
_LANES = (Rectangle(center=(0.0, 0.0), size=(3.0, 1.5)),)
_LANE_Y_M = (0.36, -0.36)
_LABEL_HEIGHT_M = 0.56
_FARTHER = 1.6
"""How much farther off teams of two are seen."""
_GHOST_OPACITY = 0.32
_FALL_RGB = (224, 49, 49)


@dataclass(frozen=True)
class Shot:
    """Where a camera stands and what it looks at, m."""

    position: tuple[float, float, float]
    look_at: tuple[float, float, float]
    fitting_aspect: float = 1.15
    """Width / height of a picture that both robots fill from there."""
    nearest: float = 0.86
    """Share of the way that it comes nearer at most: a wider picture is filled by its
    height."""

    def from_afar(self, aspect: float) -> tuple[float, float, float]:
        """Where it stands so that both robots fit a picture of width / height."""
        share = max(self.nearest, self.fitting_aspect / aspect)
        x, y, z = (
            to + share * (at - to)
            for at, to in zip(self.position, self.look_at, strict=True)
        )
        return x, y, z


SHOTS: dict[View, Shot] = {
    "treadmill": Shot((0.0, -2.85, 0.92), (0.0, 0.0, 0.04)),
    "lanes": Shot((-1.3, -2.0, 1.2), (0.15, 0.0, 0.02)),
}
_SHELF_SHOT = Shot((0.0, -2.85, 1.05), (0.0, 0.0, 0.55), 0.48, 0.72)
_SHELF_LABEL_M = 0.5
"""Lower, so that the name of one is not read as that of the other."""
_NARROW_ASPECT = 0.9
"""Width / height of a picture below which one robot stands above the other."""
FOV_RAD = 0.72


@dataclass(frozen=True, eq=False)
class Pose:
    """One robot at one moment."""

    positions: np.ndarray
    """[I, 3] m, world frame, float32"""
    wxyzs: np.ndarray
    """[I, 4] float32"""
    path: np.ndarray
    """[2] m, the ground point the view follows."""
    fallen: bool = False
    """Whether the robot lies where it fell."""
    way: tuple[np.ndarray, np.ndarray] | None = None
    """Marks of the way it is told to go, [W, 3] m and wxyz [W, 4], float32."""


class RobotView:
    """The meshes of one robot in the colour of one side."""

    def __init__(
        self,
        scene: SceneApi,
        geometry: RobotGeometry,
        side: int,
        *,
        ghost: bool = False,
    ) -> None:
        self.geometry = geometry
        opacity = _GHOST_OPACITY if ghost else 1.0
        files = tinted_glbs(geometry, COLOURS[side], opacity)
        kind = "ghost" if ghost else "robot"
        self._handles: list[BatchedGlbHandle] = []
        self._parts: list[tuple[Mover, slice]] = []
        for index, (file, mesh) in enumerate(zip(files, geometry.meshes, strict=True)):
            count = len(mesh.body_ids)
            handle = scene.add_batched_glb(
                f"/{kind}_{NAMES[side]}/{geometry.key}/{index}",
                file,
                batched_positions=np.zeros((count, 3), dtype=np.float32),
                batched_wxyzs=np.tile((1.0, 0.0, 0.0, 0.0), (count, 1)),
                # Coarser meshes for far robots would cost a worker; none is far here.
                lod="off",
                cast_shadow=not ghost,
                visible=False,
            )
            self._handles.append(handle)
            rows = geometry.instance_slices[index]
            self._parts.append((Mover(scene, handle.name), rows))

    def show(self, visible: bool) -> None:
        """Draw it or not."""
        for handle in self._handles:
            handle.visible = visible

    def move(self, positions: np.ndarray, wxyzs: np.ndarray) -> None:
        """Put the instances at `positions` [I, 3], turned by `wxyzs` [I, 4]."""
        for mover, rows in self._parts:
            mover.move(positions[rows], wxyzs[rows])


class PairScene:
    """The 3D part of the page of one client."""

    def __init__(self, client: viser.ClientHandle, *, robots: int = 2) -> None:
        """Make the floors; `robots` is 1 or 2."""
        self._client = client
        self._plates = _PLATES if robots == 2 else _ONE_PLATE
        self._lane_y = _LANE_Y_M if robots == 2 else (0.0,)
        scene = client.scene
        scene.set_up_direction("+z")
        self.view: View = "treadmill"
        self._floors: dict[View, Floor] = {
            "treadmill": Floor(scene, "/plates", self._plates),
            "lanes": Floor(scene, "/lanes", _LANES),
        }
        self._shelves = Floor(scene, "/shelves", _SHELVES) if robots == 2 else None
        self._narrow = self._of_teams = False
        self._robots: tuple[dict[str, RobotView], ...] = ({}, {})
        self._shown: list[RobotView | None] = [None, None]
        self._fallen = [False, False]
        self._labels = [
            scene.add_label(
                f"/label_{name}", name, anchor="bottom-center", font_screen_scale=1.35
            )
            for name in NAMES
        ]
        self._ways = [WayMarks(scene, name) for name in NAMES]
        self._ghosts: tuple[dict[str, RobotView], ...] = ({}, {})
        self._ghostly = False
        self._marks = [_fall_mark(scene, name) for name in NAMES]
        self.look(self.view)

    def show(self, left: RobotGeometry | None, right: RobotGeometry | None) -> None:
        """Draw these robots; their meshes are sent only the first time."""
        for side, geometry in enumerate((left, right)):
            known = self._robots[side]
            robot = None
            if geometry is not None:
                if geometry.key not in known:
                    known[geometry.key] = RobotView(self._client.scene, geometry, side)
                robot = known[geometry.key]
            before = self._shown[side]
            if before is not robot:
                if before is not None:
                    before.show(False)
                if robot is not None:
                    robot.show(True)
                self._shown[side] = robot
            self._labels[side].visible = robot is not None
            self._ways[side].show(robot is not None)
        of_teams = any(g is not None and g.robots > 1 for g in (left, right))
        if of_teams != self._of_teams:
            self._of_teams = of_teams
            self.look(self.view)
        self._show_ghosts()

    def toggle_ghosts(self) -> None:
        """Show each robot's clip on the other's place as well, or not any more."""
        self._ghostly = not self._ghostly
        self._show_ghosts()

    def draw(self, left: Pose | None, right: Pose | None) -> None:
        """Put both robots into their poses; call inside `client.atomic()`."""
        poses = (left, right)
        paths = [np.zeros(2) if pose is None else pose.path for pose in poses]
        if self.view == "lanes":
            shown = [pose.path for pose in poses if pose is not None]
            shared = np.mean(shown, axis=0) if shown else np.zeros(2)
            grounds, centers = [shared, shared], [(0.0, y) for y in self._lane_y]
            self._floors["lanes"].scroll(np.array([shared]))
        else:
            grounds, centers = paths, [plate.center for plate in self._standing]
            self._floor.scroll(np.array(paths[: len(self._standing)]))
        for side, pose in enumerate(poses):
            if pose is not None:
                up = self._heights[side]
                self._draw_robot(side, pose, _shift(centers[side], grounds[side], up))
                if self._ghostly:
                    up = self._heights[1 - side]
                    there = _shift(centers[1 - side], grounds[side], up)
                    self._draw_ghost(side, pose, there)

    def look(self, view: View) -> None:
        """Show this view from where it is best seen."""
        self.view, camera = view, self._client.camera
        side_by_side = view == "lanes" or self._shelves is None
        self._narrow = not side_by_side and aspect_of(camera) < _NARROW_ASPECT
        for floor in self._all_floors:
            floor.visible = floor is self._floor
        if view == "treadmill":
            for side, plate in enumerate(self._standing):
                above = _SHELF_LABEL_M if self._narrow else _LABEL_HEIGHT_M
                self._labels[side].position = (*plate.center, plate.height_m + above)
        shot = self._shot
        with self._client.atomic():
            camera.up_direction = (0.0, 0.0, 1.0)
            camera.position = shot.from_afar(aspect_of(camera))
            camera.look_at = shot.look_at
            camera.fov = FOV_RAD

    def is_seen_as_set(self, camera: viser.CameraHandle) -> bool:
        """Whether a visitor's camera stands where `look` put it."""
        shot = self._shot
        stands = shot.from_afar(aspect_of(camera))
        return bool(np.allclose(camera.position, stands, atol=0.02))

    def darken(self, dark: bool) -> None:
        """Floors for the light or the dark theme."""
        for floor in self._all_floors:
            floor.colour(DARK if dark else LIGHT)

    @property
    def _shot(self) -> Shot:
        """From where it is seen; teams from farther off and above."""
        shot = _SHELF_SHOT if self._narrow else SHOTS[self.view]
        if not self._of_teams:
            return shot
        x, y, z = shot.position
        return replace(shot, position=(_FARTHER * x, _FARTHER * y, 1.6 * _FARTHER * z))

    @property
    def _standing(self) -> tuple[Rectangle, ...]:
        """What each robot stands on, each on its own."""
        return _SHELVES if self._narrow else self._plates

    @property
    def _heights(self) -> tuple[float, float]:
        """How high the ground of each robot is, m."""
        return (_SHELVES[0].height_m, 0.0) if self._narrow else (0.0, 0.0)

    @property
    def _floor(self) -> Floor:
        """What is seen of the floors."""
        shelves = self._shelves if self._narrow else None
        return shelves or self._floors[self.view]

    @property
    def _all_floors(self) -> tuple[Floor, ...]:
        shelves = () if self._shelves is None else (self._shelves,)
        return (*self._floors.values(), *shelves)

    def _show_ghosts(self) -> None:
        """Make the ghosts that are wanted and not there yet; their meshes are large."""
        for side, robot in enumerate(self._shown):
            known = self._ghosts[side]
            for ghost in known.values():
                ghost.show(False)
            if robot is None or not self._ghostly:
                continue
            key = robot.geometry.key
            if key not in known:
                scene = self._client.scene
                known[key] = RobotView(scene, robot.geometry, side, ghost=True)
            known[key].show(True)

    def _draw_ghost(self, side: int, pose: Pose, shift: np.ndarray) -> None:
        robot = self._shown[side]
        if robot is not None:
            ghost = self._ghosts[side][robot.geometry.key]
            ghost.move(pose.positions + shift, pose.wxyzs)

    def _draw_robot(self, side: int, pose: Pose, shift: np.ndarray) -> None:
        robot = self._shown[side]
        if robot is None:
            return
        robot.move(pose.positions + shift, pose.wxyzs)
        if pose.way is not None:
            positions, wxyzs = pose.way
            self._ways[side].move(positions + shift, wxyzs)
        if self.view == "lanes":
            x, y = pose.path + shift[:2]
            self._labels[side].position = (float(x), float(y), _LABEL_HEIGHT_M)
        if pose.fallen != self._fallen[side]:
            self._fallen[side] = pose.fallen
            self._labels[side].text = NAMES[side] + (" fell" if pose.fallen else "")
            self._marks[side].visible = pose.fallen
        if pose.fallen:
            x, y, _ = pose.positions[0] + shift
            height_m = float(shift[2]) + 0.002
            self._marks[side].position = (float(x), float(y), height_m)


def aspect_of(camera: viser.CameraHandle) -> float:
    """Width / height of a visitor's picture; 1 of a window that shows none."""
    if not (camera.image_width and camera.image_height):
        return 1.0
    return camera.image_width / camera.image_height


def _shift(
    center: tuple[float, float], ground: np.ndarray, height_m: float
) -> np.ndarray:
    """What brings a point of the ground [2] to a place of the scene, [3] m."""
    x, y = np.asarray(center) - ground
    return np.array([x, y, height_m], dtype=np.float32)


def _fall_mark(scene: SceneApi, name: str) -> viser.MeshHandle:
    """A red disc for the ground under a robot that fell."""
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    rim = np.stack([0.36 * np.cos(angle), 0.30 * np.sin(angle), 0 * angle], axis=-1)
    corners = np.arange(1, 41)
    faces = np.stack([np.zeros_like(corners), corners, np.roll(corners, -1)], axis=-1)
    return scene.add_mesh_simple(
        f"/fall_{name}",
        vertices=np.concatenate([np.zeros((1, 3)), rim]),
        faces=faces,
        color=_FALL_RGB,
        opacity=0.55,
        cast_shadow=False,
        visible=False,
    )


def rgb8(rgb: Rgb) -> tuple[int, int, int]:
    """A colour as whole numbers."""
    red, green, blue = (round(255 * channel) for channel in rgb)
    return red, green, blue
