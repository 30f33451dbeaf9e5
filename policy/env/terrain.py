"""Ground to walk on: slopes, steps or rubble instead of a plane, made from a seed.

All robots of a batch share one field. They start anywhere on it and face its middle;
who comes near the edge is cut off like by a time-out, which says nothing bad about the
policy.

Shapes: R rows and C columns of the field, K robots that start.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
import torch
from torch import Tensor

from policy.robots.anatomy import bodies_below
from policy.robots.foot import collides
from policy.robots.ground_shape import TERRAIN_NAME, forget
from policy.robots.robot import Robot, RobotError, load_robot_xml
from policy.sim.field import Field

from .task_reward import size_of

TerrainKind = Literal["flat", "slopes", "steps", "rough"]

EDGE_M = 0.6
"""An episode ends this far from the edge of the field."""
_TURN_RAD = 0.5
"""How far a robot may start turned away from the middle."""
_LIFT_M = 0.03
"""Lift of the start, for feet that are not quite where they are at home."""
THICKNESS_M = 0.5
_DIGITS = 3
"""Digits of a height, as a share of the field's: more only lengthen the text."""


@dataclass(frozen=True, kw_only=True)
class TerrainCfg:
    """Ground to walk on; lengths are those for the robot that ships."""

    kind: TerrainKind = "flat"
    """A plane, gentle hills, terraces, or rubble."""
    seed: int = 0
    """Which of all such fields."""
    size_m: float = 12.0
    """Length of the field's sides: a fast robot crosses it in one episode."""
    cell_m: float = 0.1
    """Distance of two heights; the edge of a step is a ramp this long."""
    slope_rad: float = 0.2
    """The steepest part of `slopes`."""
    step_m: float = 0.05
    """Height of a step of `steps`."""
    tread_m: float = 0.4
    """Depth of a step where the terraces are narrowest."""
    rough_m: float = 0.04
    """Largest difference in height of `rough`, from one point to any other."""

    def __post_init__(self) -> None:
        if not self.size_m > 4 * EDGE_M:
            raise ValueError(f"size_m must be above {4 * EDGE_M}, got {self.size_m}")
        for name in ("cell_m", "slope_rad", "step_m", "tread_m", "rough_m"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")


def heights(cfg: TerrainCfg, *, taller: float = 1.0) -> np.ndarray:
    """Heights [R, C] in m, 0 in the middle, for a robot `taller` than ours."""
    rng = np.random.default_rng(cfg.seed)
    points = round(cfg.size_m / cfg.cell_m) + 1
    match cfg.kind:
        case "slopes":
            field = _hills(rng, points, cfg.cell_m) * np.tan(cfg.slope_rad)
        case "steps":
            steepest = cfg.step_m / cfg.tread_m
            hills = _hills(rng, points, cfg.cell_m) * steepest
            field = np.round(hills / cfg.step_m) * cfg.step_m * taller
        case "rough":
            field = rng.uniform(0.0, cfg.rough_m * taller, (points, points))
        case "flat":
            field = np.zeros((points, points))
    return field - field[points // 2, points // 2]


def _hills(rng: np.random.Generator, points: int, cell_m: float) -> np.ndarray:
    """Waves from all sides [points, points], at most 1 m up per m."""
    place = cell_m * np.arange(points)
    x, y = np.meshgrid(place, place)
    hills = np.zeros((points, points))
    for angle in np.linspace(0, np.pi, 6, endpoint=False) + rng.uniform(0, np.pi / 6):
        length_m, phase = rng.uniform(2.0, 5.0), rng.uniform(0, 2 * np.pi)
        along = np.cos(angle) * x + np.sin(angle) * y
        hills += length_m * np.sin(2 * np.pi * along / length_m + phase)
    down_y, down_x = np.gradient(hills, cell_m)
    return hills / np.hypot(down_x, down_y).max()


def on_terrain(robot: Robot, cfg: TerrainCfg) -> Robot:
    """`robot` on the ground `cfg` asks for, instead of its floor.

    A robot that has such ground keeps it. The model's text carries the field, so that
    an episode can be drawn from its file alone.

    Raises:
        RobotError: the robot's floor is turned.
    """
    if cfg.kind == "flat" or robot.ground is not None:
        return robot
    field = heights(cfg, taller=size_of(robot)[0])
    low, tall = float(field.min()), max(float(np.ptp(field)), 1e-3)
    spec = mujoco.MjSpec.from_string(robot.mjcf)
    # The elements of a spec have ids once it is compiled.
    spec.compile()
    floor = floor_of(spec, robot)
    spec.add_hfield(
        name=TERRAIN_NAME,
        nrow=field.shape[0],
        ncol=field.shape[1],
        size=[cfg.size_m / 2, cfg.size_m / 2, tall, THICKNESS_M],
        userdata=((field - low) / tall).round(_DIGITS).ravel().tolist(),
    )
    floor.type, floor.hfieldname = mujoco.mjtGeom.mjGEOM_HFIELD, TERRAIN_NAME
    floor.pos, floor.quat, floor.size = (0, 0, low), (1, 0, 0, 0), (0, 0, 0)
    return load_robot_xml(
        spec.to_xml(), name=robot.name, physics_dt_s=robot.mj_model.opt.timestep
    )


def floor_of(spec: mujoco.MjSpec, robot: Robot) -> mujoco.MjsGeom:
    """The floor in `spec`; of several, which are the same plane, one is left."""
    mj_model = robot.mj_model
    own = bodies_below(mj_model, robot.base_body_id)
    floors = [
        geom
        for geom in range(mj_model.ngeom)
        if mj_model.geom_bodyid[geom] not in own and collides(mj_model, geom)
    ]
    body = int(mj_model.geom_bodyid[floors[0]])
    if body and not (
        np.allclose(mj_model.body_pos[body], 0)
        and np.allclose(mj_model.body_quat[body], (1, 0, 0, 0))
    ):
        raise RobotError(
            f"{robot.name}: its floor is part of body {mj_model.body(body).name!r}, "
            "which is moved or turned; put it into the worldbody, or train on flat "
            "ground"
        )
    geoms = {geom.id: geom for geom in spec.geoms}
    names = [geoms[geom].name for geom in floors[1:] if geoms[geom].name]
    for geom in floors[1:]:
        spec.delete(geoms[geom])
    forget(spec, names)
    return geoms[floors[0]]


class Starts:
    """Where on a field robots start."""

    def __init__(self, robot: Robot, field: Field) -> None:
        self._field = field
        feet_w = robot.home_foot_pos_w[:, :2]
        feet = torch.from_numpy(feet_w - feet_w.mean(axis=0))
        self._feet = feet.to(field.device)  # [4, 2] from their middle

    def place(self, qpos: Tensor, draw: Callable[[int, int], Tensor]) -> None:
        """Move the states `qpos` [K, nq] of robots at the origin onto the field.

        They face its middle, more or less, so that few of them reach the edge, and
        lean as the ground under their feet does.

        Args:
            qpos: Changed in place.
            draw: Gives [rows, width] of uniform draws in [-1, 1].
        """
        field = self._field
        draws = draw(len(qpos), 3).double()
        reach = field.half_m - 2 * EDGE_M
        there = field.middle_m + reach * draws[:, :2]
        away = there - field.middle_m
        yaw = _direction_rad(-away) + _TURN_RAD * draws[:, 2]
        c, s = (each[:, None] for each in _cos_sin(yaw))
        x, y = self._feet.T
        feet = torch.stack([c * x - s * y, s * x + c * y], dim=-1) + there[:, None]
        below = field.height_m(feet)  # [K, 4]
        up_x, up_y = (_times(below, each / (each @ each)) for each in (x, y))
        plane = torch.outer(up_x, x) + torch.outer(up_y, y)
        qpos[:, :2] = there
        qpos[:, 2] += (below - plane).amax(dim=1) + _LIFT_M
        attitude = qpos[:, 3:7]
        for axis, angle in enumerate((torch.atan(up_y), -torch.atan(up_x), yaw)):
            attitude = turned(attitude, angle, axis=axis)
        qpos[:, 3:7] = attitude


# The last bit of a sine or a sum in NumPy is not PyTorch's, and where a robot starts on
# the CPU is to stay what it was.


def _times(matrix: Tensor, vector: Tensor) -> Tensor:
    if matrix.device.type == "cpu":
        return torch.from_numpy(matrix.numpy() @ vector.numpy())
    return matrix @ vector


def _direction_rad(vector: Tensor) -> Tensor:
    x, y = vector.unbind(-1)
    if x.device.type == "cpu":
        return torch.from_numpy(np.arctan2(y.numpy(), x.numpy()))
    return torch.atan2(y, x)


def _cos_sin(angle_rad: Tensor) -> tuple[Tensor, Tensor]:
    if angle_rad.device.type == "cpu":
        angle = angle_rad.numpy()
        return torch.from_numpy(np.cos(angle)), torch.from_numpy(np.sin(angle))
    return torch.cos(angle_rad), torch.sin(angle_rad)


def turned(wxyz: Tensor, angle_rad: Tensor, *, axis: int) -> Tensor:
    """The attitudes `wxyz` [K, 4] turned by `angle_rad` [K] about world x, y or z."""
    half = angle_rad / 2
    w, vector = wxyz[:, :1], wxyz[:, 1:]
    by = torch.zeros_like(vector)
    by[:, axis] = torch.sin(half)
    c = torch.cos(half)[:, None]
    scalar = c * w - (by * vector).sum(dim=-1, keepdim=True)
    return torch.cat((scalar, c * vector + w * by + by.cross(vector, dim=-1)), dim=-1)


def near_edge(field: Field, base_pos_w: Tensor) -> Tensor:
    """Which of the bases at `base_pos_w` [N, 3] have come to the edge, [N]."""
    return ~field.inside(base_pos_w[:, :2].double(), margin_m=EDGE_M)
