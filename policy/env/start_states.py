"""The states that episodes begin in: near home, where the world wants them, or lying.

Shapes: K robots that begin, nq positions and nv velocities of the model.
"""

from __future__ import annotations

import torch
from torch import Tensor

from policy.robots.robot import Robot

from .course import Lane
from .draws import around_zero, uniforms
from .env_cfg import ResetCfg
from .getup import Lying
from .terrain import Starts


class StartStates:
    """Draws states that episodes begin in."""

    def __init__(
        self,
        robot: Robot,
        cfg: ResetCfg,
        device: torch.device,
        *,
        places: Lane | Starts | None = None,
        lying: Lying | None = None,
    ) -> None:
        """
        Args:
            robot: The robot.
            cfg: How far from home.
            device: Where the states are wanted.
            places: Where in the world robots begin; at its origin by default.
            lying: The poses of robots that have to get up; all begin in these.
        """

        def constant(values: object) -> Tensor:
            return torch.tensor(values, dtype=torch.float32, device=device)

        self._cfg, self._places, self._lying = cfg, places, lying
        self._nv = robot.mj_model.nv
        self._home_qpos = torch.tensor(robot.home_qpos, dtype=torch.float64).to(device)
        self._home_joint_pos = constant(robot.home_joint_pos)
        self._low, self._high = constant(robot.joint_range).unbind(-1)
        self._joint_qpos = torch.tensor(robot.qpos_adr, device=device)
        self._joint_qvel = torch.tensor(robot.qvel_adr, device=device)

    def draw(self, count: int, rng: torch.Generator) -> tuple[Tensor, Tensor]:
        """States [K, nq] and [K, nv]."""
        qvel = torch.zeros(count, self._nv, dtype=torch.float64, device=rng.device)
        if self._lying is not None:
            return self._lying.draw(count, rng), qvel
        cfg = self._cfg
        offsets, lift, half_tilts, lin_vel, ang_vel, joint_vel = uniforms(
            rng,
            count,
            (12, around_zero(cfg.joint_pos_rad)),
            (1, (0.0, cfg.height_m)),
            (2, around_zero(cfg.tilt_rad)),
            (3, around_zero(cfg.base_lin_vel_m_s)),
            (3, around_zero(cfg.base_ang_vel_rad_s)),
            (12, around_zero(cfg.joint_vel_rad_s)),
        )
        half_tilts = half_tilts / 2
        joints = (self._home_joint_pos + offsets).clamp(self._low, self._high)
        qpos = self._home_qpos.repeat(count, 1)
        qpos[:, self._joint_qpos] = joints.double()
        qpos[:, 2:3] += lift
        qpos[:, 3] = (1 - half_tilts.square().sum(-1)).sqrt()
        qpos[:, 4:6] = half_tilts
        qpos[:, 6] = 0.0
        if self._places is not None:
            self._places.place(
                qpos,
                lambda rows, width: uniforms(rng, rows, (width, around_zero(1.0)))[0],
            )
        qvel[:, 0:3] = lin_vel
        qvel[:, 3:6] = ang_vel
        qvel[:, self._joint_qvel] = joint_vel.double()
        return qpos, qvel
