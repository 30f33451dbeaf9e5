"""A policy in another posture: what would people say if it walked taller?

Clips of one policy look alike in what the policy never varies, and no answer about them
tells whether that habit is wanted. So some episodes are recorded with the feet shifted
against the base, by a constant in every episode, and with larger or smaller actions.

Shapes: N environments.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import torch
from torch import Tensor

from policy.env.task_reward import size_of
from policy.robots.robot import Robot

from .rollout import Actor

_DAMPING = 1e-4
"""m^2, against huge joint offsets where a leg is nearly straight."""


@dataclass(frozen=True, kw_only=True)
class VariationCfg:
    """How far a posture is varied; lengths are those for the robot that ships."""

    share: float = 0.0
    """Share of a policy's episodes that show it in another posture."""
    height_m: float = 0.05
    """The base is carried higher or lower by up to this."""
    width_m: float = 0.03
    """Each foot stands farther out or in by up to this."""
    length_m: float = 0.03
    """Front and rear feet stand farther forward or back by up to this, apart."""
    gain: float = 0.25
    """Actions are larger or smaller by up to this share of themselves."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.share <= 1.0:
            raise ValueError(f"share must lie in [0, 1], got {self.share}")
        if not 0.0 <= self.gain < 1.0:
            raise ValueError(f"gain must lie in [0, 1), got {self.gain}")


class Varied:
    """An actor whose actions are scaled and shifted, each episode's by a constant.

    Where the share says so; elsewhere it acts as the other actor does.
    """

    def __init__(
        self,
        actor: Actor,
        robot: Robot,
        cfg: VariationCfg,
        num_envs: int,
        *,
        action_scale_rad: float | Tensor,
        rng: torch.Generator,
    ) -> None:
        """Draw which environments vary, and how."""
        self._actor = actor

        def uniform(limit: float, *shape: int) -> Tensor:
            return limit * (2 * torch.rand(num_envs, *shape, generator=rng) - 1)

        taller, _ = size_of(robot)
        self.chosen = torch.rand(num_envs, generator=rng) < cfg.share
        """[N] whether an environment varies"""
        height, width = uniform(cfg.height_m, 1), uniform(cfg.width_m, 1)
        ahead = uniform(cfg.length_m, 2)[:, [0, 0, 1, 1]]
        # Legs are FR, FL, RR, RL; y points left.
        outward = width * torch.tensor([-1.0, 1.0, -1.0, 1.0])
        shift_b = torch.stack((ahead, outward, -height.expand(-1, 4)), dim=-1)
        legs = torch.from_numpy(joints_per_shift(robot)).float()
        offset = torch.einsum("ljx,nlx->nlj", legs, taller * shift_b).flatten(1)
        self._offset = torch.where(
            self.chosen[:, None], offset / action_scale_rad, torch.zeros(())
        )
        self._gain = torch.where(
            self.chosen[:, None], 1 + uniform(cfg.gain, 1), torch.ones(())
        )

    def __call__(self, obs: Tensor, noise: Tensor | None = None) -> Tensor:
        """Actions [N, 12]."""
        return self._gain * self._actor(obs, noise) + self._offset


def joints_per_shift(robot: Robot) -> np.ndarray:
    """[4, 3, 3] rad/m: what each leg's joints do for a shift of its foot, x y z in the
    frame of the base, about the home pose (damped least squares)."""
    mj_data = mujoco.MjData(robot.mj_model)
    mj_data.qpos[:] = robot.home_qpos
    mujoco.mj_kinematics(robot.mj_model, mj_data)
    mujoco.mj_comPos(robot.mj_model, mj_data)
    base_w = mj_data.xmat[robot.base_body_id].reshape(3, 3)
    jacobian_w = np.zeros((3, robot.mj_model.nv))
    found = []
    for leg, site in enumerate(robot.foot_site_ids):
        mujoco.mj_jacSite(robot.mj_model, mj_data, jacobian_w, None, int(site))
        joints = robot.qvel_adr[3 * leg : 3 * leg + 3]
        jacobian_b = base_w.T @ jacobian_w[:, joints]
        square = jacobian_b @ jacobian_b.T + _DAMPING * np.eye(3)
        found.append(jacobian_b.T @ np.linalg.inv(square))
    return np.stack(found)
