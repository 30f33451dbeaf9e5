"""The seam between the environment and a simulator of many copies of one robot.

Everything a simulator takes and gives is torch on its own device.

Shapes: N environments, K rows of values that are handed over.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from data.errors import GaitprefError
from policy.robots.robot import Robot

from .chosen import Rows
from .draw import Draw


class SimError(GaitprefError):
    """A simulator that cannot be had here."""


@dataclass(frozen=True, eq=False)
class SimState:
    """What the environment reads after a control step; float32 on the sim's device."""

    base_pos_w: Tensor
    """[N, 3] m"""
    base_wxyz_w: Tensor
    """[N, 4]"""
    base_lin_vel_w: Tensor
    """[N, 3] m/s"""
    base_ang_vel_b: Tensor
    """[N, 3] rad/s"""
    joint_pos: Tensor
    """[N, 12] rad"""
    joint_vel: Tensor
    """[N, 12] rad/s"""
    joint_torque: Tensor
    """[N, 12] N m, of the last physics step"""
    foot_vel_w: Tensor
    """[N, 4, 3] m/s"""
    foot_contact: Tensor
    """[N, 4] 0 or 1"""
    base_contact: Tensor
    """[N] 0 or 1"""
    base_height: Tensor
    """[N] m above the ground below it"""
    foot_height: Tensor
    """[N, 4] m, foot sites above the ground below them"""


class Sim(Protocol):
    """A simulator of N copies of one robot."""

    robot: Robot
    num_envs: int
    device: torch.device

    def rows(self, mask: Tensor) -> Rows | None:
        """The simulations of `mask` [N]; None where it is known that there is none."""
        ...

    def set_targets(self, joint_pos: Tensor) -> None:
        """Joint positions [N, 12] the servos hold until the next call, rad."""
        ...

    def advance(self, substeps: int) -> Tensor:
        """Run physics; gives a mask [N] of simulations that went bad."""
        ...

    def read(self, rows: Rows | None = None) -> SimState:
        """The current state, of simulations `rows` [K] alone if given."""
        ...

    def reset(self, rows: Rows, qpos: Tensor, qvel: Tensor) -> None:
        """Put simulations `rows` into the states `qpos` [K, nq], `qvel` [K, nv]."""
        ...

    def raw_state(self) -> tuple[Tensor, Tensor]:
        """Copies of qpos [N, nq] and qvel [N, nv], float64."""
        ...

    def snapshot(self) -> Tensor:
        """Everything needed to go on from here, float64 [N, S]."""
        ...

    def restore(self, snapshot: Tensor) -> None:
        """Go on from a `snapshot` of the same robot and number of environments.

        Raises:
            ValueError: the snapshot is of another robot or number of environments.
        """
        ...


class VariedSim(Sim, Protocol):
    """A simulator whose copies differ."""

    draw: Draw
    """How they do."""
    late_targets: Tensor
    """[N, 12] rad, what servos are told where targets arrive one control step late."""

    def vary(self, rows: Rows, draw: Draw) -> None:
        """Make the robots `rows` as `draw` [K] says, from their next reset on."""
        ...

    def push(self, rows: Rows, velocity_m_s: Tensor) -> None:
        """Change the horizontal velocities of the bases `rows` by [K, 2]."""
        ...


def require_fits(snapshot: Tensor, shape: tuple[int, ...]) -> None:
    """See `Sim.restore`."""
    if tuple(snapshot.shape) != shape:
        raise ValueError(
            f"the saved simulation state is {tuple(snapshot.shape)}, this robot, "
            f"simulator and number of environments need {shape}"
        )
