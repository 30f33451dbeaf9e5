"""A course of obstacles one behind the other, and what lies ahead of a robot on it.

Robots walk along x, from the line x = 0, over steps and a slope and below a bar;
between them the ground is open. Who chooses gaits is told what is ahead, a gait is not.

Shapes: N robots, O obstacles, C columns of the field.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
import torch
from torch import Tensor

from data.course_marks import BAR_PREFIX
from data.features import Feature
from policy.robots.ground_shape import TERRAIN_NAME
from policy.robots.robot import Robot, RobotError, load_robot_xml

from .task_reward import size_of
from .terrain import EDGE_M, THICKNESS_M, floor_of, turned

ObstacleKind = Literal["steps", "slope", "bar"]
KINDS: tuple[ObstacleKind, ...] = ("steps", "slope", "bar")
SIGHT_M = 1.5
"""What is farther away is not seen."""
AHEAD = (
    Feature(
        "next", len(KINDS), "0 or 1", "kind of the next obstacle: steps, slope, bar"
    ),
    Feature("distance", 1, "m", "to its beginning; 0 on or below it, at most 1.5"),
    Feature("left", 1, "m", "to its end, at most 1.5"),
    Feature("time", 1, "s", "since the episode began"),
)
"""What a chooser of gaits sees beside an observation."""
AHEAD_DIM = sum(part.width for part in AHEAD)
_GRIP = 0.7
"""Tangent of the steepest slope that feet hold on; a floor's friction is mostly 0.8."""
_REACH_M = 0.3
"""From the base to the front and rear feet: an obstacle begins and ends for a robot
where they do."""
_CELL_M = 0.05
_BAR_M = (0.03, 0.08)
"""Half of the least thickness of a bar along the way, and of its height."""
_DIGITS = 4


@dataclass(frozen=True, kw_only=True)
class Obstacle:
    """One obstacle across the whole way."""

    kind: ObstacleKind
    start_m: float
    """Where it begins, from the line robots start at."""
    length_m: float

    @property
    def end_m(self) -> float:
        """Where it ends."""
        return self.start_m + self.length_m


@dataclass(frozen=True, kw_only=True)
class CourseCfg:
    """A course; lengths along the way are in m for any robot, heights for ours."""

    obstacles: tuple[Obstacle, ...] = (
        Obstacle(kind="steps", start_m=1.2, length_m=2.0),
        Obstacle(kind="bar", start_m=4.2, length_m=0.4),
        Obstacle(kind="slope", start_m=5.6, length_m=1.2),
    )
    """In the order in which they come, with open ground between them."""
    length_m: float = 7.6
    """From the start to the finish, which ends an episode like a time-out."""
    width_m: float = 6.0
    """Across the way; who leaves it is cut off."""
    step_m: float = 0.04
    """Height of a step; up and down again by threes."""
    slope_rad: float = 0.2
    """Up for one half of a slope, down for the other."""
    bar_m: float = 0.29
    """From the ground to the lower edge of the bar."""
    anywhere: bool = False
    """Begin anywhere on open ground, to learn from, and not at the line."""

    def __post_init__(self) -> None:
        if not self.obstacles:
            raise RobotError("a course needs an obstacle: there is nothing to choose")
        before = 0.0
        for obstacle in self.obstacles:
            if obstacle.kind not in KINDS:
                raise RobotError(
                    f"a course has no {obstacle.kind!r}; there are: {', '.join(KINDS)}"
                )
            if obstacle.length_m <= 0 or obstacle.start_m < before + 2 * _REACH_M:
                raise RobotError(
                    f"the {obstacle.kind} at {obstacle.start_m:g} m need a length and "
                    f"{2 * _REACH_M:g} m of open ground before them; the one before "
                    f"ends at {before:g} m"
                )
            before = obstacle.end_m
        if self.length_m < before + _REACH_M:
            raise RobotError(
                f"the course ends at {self.length_m:g} m, its last obstacle at "
                f"{before:g} m: make it at least {before + _REACH_M:g} m long"
            )
        for name, most in (("step_m", 1.0), ("slope_rad", 1.0), ("bar_m", 10.0)):
            if not 0 < getattr(self, name) <= most:
                raise RobotError(
                    f"{name} must lie in (0, {most:g}], got {getattr(self, name):g}"
                )
        if not self.width_m > 4 * EDGE_M:
            raise RobotError(
                f"width_m must be above {4 * EDGE_M:g}, got {self.width_m:g}"
            )


def course_heights(cfg: CourseCfg, *, taller: float = 1.0) -> np.ndarray:
    """Heights [C] in m along x, from `2 * EDGE_M` before the line to `EDGE_M` behind
    the finish."""
    x = np.arange(-2 * EDGE_M, cfg.length_m + EDGE_M + _CELL_M / 2, _CELL_M)
    heights = np.zeros_like(x)
    for obstacle in cfg.obstacles:
        share = (x - obstacle.start_m) / obstacle.length_m
        up = 1.0 - np.abs(2.0 * share.clip(0.0, 1.0) - 1.0)
        if obstacle.kind == "slope":
            heights += up * np.tan(cfg.slope_rad) * obstacle.length_m / 2
        elif obstacle.kind == "steps":
            # Three up, of which the highest is as long as two of the others.
            level = np.ceil(np.minimum(3 * up, 3.0).round(6))
            heights += level * cfg.step_m * taller
    return heights


def on_course(robot: Robot, cfg: CourseCfg) -> Robot:
    """`robot` on the course, instead of its floor; one that is on it already stays.

    Raises:
        RobotError: the robot's floor is turned, or nothing can stand below the bar.
    """
    if robot.ground is not None:
        return robot
    taller, _ = size_of(robot)
    field = np.tile(course_heights(cfg, taller=taller), (2, 1))
    tall = max(float(field.max()), 1e-3)
    half = ((field.shape[1] - 1) * _CELL_M / 2, cfg.width_m / 2)
    spec = mujoco.MjSpec.from_string(robot.mjcf)
    spec.compile()
    floor = floor_of(spec, robot)
    spec.add_hfield(
        name=TERRAIN_NAME,
        nrow=2,
        ncol=field.shape[1],
        size=[*half, tall, THICKNESS_M],
        userdata=(field / tall).round(_DIGITS).ravel().tolist(),
    )
    floor.type, floor.hfieldname = mujoco.mjtGeom.mjGEOM_HFIELD, TERRAIN_NAME
    floor.pos, floor.quat = (half[0] - 2 * EDGE_M, 0, 0), (1, 0, 0, 0)
    floor.size = (0, 0, 0)
    for number, obstacle in enumerate(cfg.obstacles):
        if obstacle.kind == "bar":
            _add_bar(spec, floor, cfg, obstacle, number, taller)
    return load_robot_xml(
        spec.to_xml(), name=robot.name, physics_dt_s=robot.mj_model.opt.timestep
    )


def _add_bar(
    spec: mujoco.MjSpec,
    floor: mujoco.MjsGeom,
    cfg: CourseCfg,
    obstacle: Obstacle,
    number: int,
    taller: float,
) -> None:
    """A box across the way, which touches what the floor touches."""
    thick, up = _BAR_M
    low = cfg.bar_m * taller
    # A body of its own: to bump against it is no contact with the ground, no fall.
    body = spec.worldbody.add_body(
        name=f"{BAR_PREFIX}{number}",
        pos=[obstacle.start_m + obstacle.length_m / 2, 0, low + up * taller / 2],
    )
    body.add_geom(
        name=f"{BAR_PREFIX}{number}",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[max(thick, obstacle.length_m / 2), cfg.width_m / 2, up * taller / 2],
        rgba=[0.85, 0.55, 0.2, 0.35],
        contype=floor.contype,
        conaffinity=floor.conaffinity,
        friction=floor.friction,
    )


class Lane:
    """Where robots are on a course, and what is ahead of them there."""

    def __init__(self, cfg: CourseCfg, device: torch.device) -> None:
        self._cfg = cfg
        obstacles = cfg.obstacles
        self._start = torch.tensor([o.start_m for o in obstacles], device=device)
        self._end = torch.tensor([o.end_m for o in obstacles], device=device)
        kinds = torch.tensor([KINDS.index(o.kind) for o in obstacles])
        self._kind = torch.nn.functional.one_hot(kinds, len(KINDS)).float().to(device)

    def ahead(self, x_m: Tensor, time_s: Tensor) -> Tensor:
        """Columns [N, 6] of `AHEAD` at places `x_m` [N]."""
        start, end = self._start - _REACH_M, self._end + _REACH_M
        # What is behind comes after everything that is ahead.
        behind = x_m[:, None] >= end
        distance = (start - x_m[:, None]).clamp_min(0.0).masked_fill(behind, torch.inf)
        nearest, which = distance.min(dim=1)
        seen = (nearest <= SIGHT_M)[:, None]
        left = (end[which] - x_m).clamp(0.0, SIGHT_M)
        return torch.cat(
            (
                self._kind[which] * seen,
                nearest.clamp_max(SIGHT_M)[:, None],
                torch.where(seen, left[:, None], SIGHT_M),
                time_s[:, None],
            ),
            dim=1,
        )

    def place(self, qpos: Tensor, draw: Callable[[int, int], Tensor]) -> None:
        """Move the states `qpos` [N, nq] of robots at the origin to where they begin.

        Args:
            qpos: Changed in place.
            draw: Gives [rows, width] of uniform draws in [-1, 1].
        """
        cfg, draws = self._cfg, draw(len(qpos), 3).double()
        qpos[:, 1] = 0.25 * cfg.width_m * draws[:, 0]
        qpos[:, 3:7] = turned(qpos[:, 3:7], 0.1 * draws[:, 1], axis=2)
        if cfg.anywhere:
            first, last = (
                draws.new_zeros(1),
                draws.new_tensor([cfg.length_m - _REACH_M]),
            )
            begins = torch.cat((first, self._end + 2 * _REACH_M))
            ends = torch.cat((self._start - 2 * _REACH_M, last))
            room = (ends - begins).clamp_min(0.0)
            # One draw says which stretch of open ground, and where on it.
            at = (draws[:, 2] + 1) / 2 * room.sum()
            before = torch.cumsum(room, 0) - room
            stretch = (at[:, None] >= before).sum(dim=1) - 1
            qpos[:, 0] = begins[stretch] + at - before[stretch]


def stands_on(robot: Robot, cfg: CourseCfg) -> None:
    """
    Raises:
        RobotError: no robot of this size could pass.
    """
    taller, _ = size_of(robot)
    stands = float(robot.home_qpos[2])
    if (
        any(o.kind == "bar" for o in cfg.obstacles)
        and cfg.bar_m * taller < 0.6 * stands
    ):
        raise RobotError(
            f"the bar hangs {cfg.bar_m * taller:.2f} m high and the base of "
            f"{robot.name} stands at {stands:.2f} m: nobody crawls that low; raise "
            f"bar_m to at least {0.6 * stands / taller:.2f}"
        )
    if cfg.step_m * taller > 0.4 * stands:
        raise RobotError(
            f"a step of {cfg.step_m * taller:.2f} m is higher than {robot.name} lifts "
            f"its feet; lower step_m to at most {0.4 * stands / taller:.2f}"
        )
    steepest = math.atan(_GRIP)
    if any(o.kind == "slope" for o in cfg.obstacles) and cfg.slope_rad > steepest:
        raise RobotError(
            f"on a slope of {cfg.slope_rad:.2f} rad feet slip, whoever climbs: lower "
            f"slope_rad to at most {steepest:.2f}"
        )
