"""MuJoCo Warp with robots that differ.

Shapes: N environments, K rows of values that are handed over.
"""

from __future__ import annotations

import torch
import warp as wp
from torch import Tensor

from policy.robots.robot import Robot

from .chosen import Rows
from .draw import Draw, factors, varied_fields
from .warp_sim import WarpSim

_FOLLOWING = (
    "body_subtreemass",
    "body_invweight0",
    "dof_invweight0",
    "actuator_acc0",
)
"""Fields that follow from masses."""


class VariedWarpSim(WarpSim):
    """`VariedSim` on `mujoco_warp`."""

    def __init__(self, robot: Robot, num_envs: int, *, device: str = "cpu") -> None:
        """See `WarpSim`."""
        super().__init__(robot, num_envs, device=device)
        self._fields = {
            name: wp.to_torch(getattr(self._model, name))
            for name in varied_fields(self._mj_model)
        }
        self._nominal = {name: each[0].clone() for name, each in self._fields.items()}
        self.draw = Draw.of_nobody(num_envs, self.device)
        home = torch.tensor(robot.home_joint_pos, dtype=torch.float32)
        self._home = home.to(self.device)
        self.late_targets = self._home.repeat(num_envs, 1)

    def _own_fields(self) -> tuple[str, ...]:
        return (*varied_fields(self._mj_model), *_FOLLOWING)

    def vary(self, rows: Rows, draw: Draw) -> None:
        """See `VariedSim.vary`."""
        columns = self.draw.columns
        rows.put(columns, draw.columns)
        self.draw = draw = Draw.of_columns(columns)
        # All worlds are written: those that are not meant get what they have.
        for name, (factor, part) in factors(self._mj_model, draw).items():
            value = self._nominal[name][..., part]
            self._fields[name][..., part] = factor.view(-1, *[1] * value.ndim) * value
        base = self.robot.base_body_id
        home = self._nominal["body_ipos"][base]
        self._fields["body_ipos"][:, base] = home + draw.com_m
        self._graphs.constants()
        self._current = False

    def set_targets(self, joint_pos: Tensor) -> None:
        """See `Sim.set_targets`; encoders lie to servos as they do to the policy."""
        arriving = self.draw.arriving(joint_pos, self.late_targets)
        self.late_targets = joint_pos.clone()
        super().set_targets(arriving)

    def reset(self, rows: Rows, qpos: Tensor, qvel: Tensor) -> None:
        """See `Sim.reset`."""
        super().reset(rows, qpos, qvel)
        rows.put(self.late_targets, self._home)

    def push(self, rows: Rows, velocity_m_s: Tensor) -> None:
        """See `VariedSim.push`."""
        first = self._at.base_qvel
        moved = self._qvel[:, first : first + 2]
        rows.put(moved, moved + velocity_m_s)
        self._current = False
