"""A quadruped in the mirror: left and right exchanged.

A quadruped that is the same on both sides moves in the mirror as the mirrored robot
does: every step it takes tells of a second one. Mittal et al. 2024, "Symmetry
Considerations for Learning Task Symmetric Robot Policies", augment minibatches so.

Shapes: 48 numbers of an observation, 12 joints of an action.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import torch
from torch import Tensor

from .robot import Robot
from .robots.hints import RobotError

_SWAPPED = np.array([3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8])
"""Joint of the other side for every joint; legs are FR, FL, RR, RL."""
_TOLERANCE_RAD = 1e-3
_VECTOR, _AXIAL = (1.0, -1.0, 1.0), (-1.0, 1.0, -1.0)
"""Signs of x forward, y left, z up of a velocity, and of a turning rate."""


@dataclass(frozen=True, eq=False)
class Mirror:
    """Observations and actions of the mirrored robot."""

    obs_idx: Tensor
    """[48] where each number comes from."""
    obs_sign: Tensor
    """[48]"""
    joint_idx: Tensor
    """[12]"""
    joint_sign: Tensor
    """[12]"""

    def obs(self, obs: Tensor) -> Tensor:
        """Observations [..., 48] of the mirrored robot."""
        return obs[..., self.obs_idx] * self.obs_sign

    def action(self, action: Tensor) -> Tensor:
        """Actions [..., 12] of the mirrored robot."""
        return action[..., self.joint_idx] * self.joint_sign


def mirror_of(robot: Robot) -> Mirror:
    """The mirror of a robot, from the axes of its joints.

    Raises:
        RobotError: its sides differ, in how joints turn or in the home pose.
    """
    axes = _axes_b(robot)
    cosine = (axes * (axes[_SWAPPED] * _AXIAL)).sum(axis=1)
    signs = np.sign(cosine)
    home = robot.home_joint_pos
    off_rad = np.abs(home - signs * home[_SWAPPED]).max()
    if np.abs(cosine).min() < 0.99 or off_rad > _TOLERANCE_RAD:
        raise RobotError(
            f"{robot.name} is not the same on both sides (joint axes agree to "
            f"{np.abs(cosine).min():.2f}, the home pose to {off_rad:.3f} rad): train "
            "without the mirror"
        )
    joints = [_SWAPPED + 9 + 12 * part for part in range(3)]
    idx = np.concatenate([np.arange(9), *joints, np.arange(45, 48)])
    command = (1.0, -1.0, -1.0)
    obs_sign = np.concatenate([_VECTOR, _AXIAL, _VECTOR, *[signs] * 3, command])
    return Mirror(
        obs_idx=torch.from_numpy(idx),
        obs_sign=torch.from_numpy(obs_sign).float(),
        joint_idx=torch.from_numpy(_SWAPPED),
        joint_sign=torch.from_numpy(signs).float(),
    )


def _axes_b(robot: Robot) -> np.ndarray:
    """[12, 3] axes of the joints in the home pose, in the frame of the base."""
    mj_data = mujoco.MjData(robot.mj_model)
    mj_data.qpos[: len(robot.home_qpos)] = robot.home_qpos
    mujoco.mj_kinematics(robot.mj_model, mj_data)
    joints = robot.mj_model.dof_jntid[robot.qvel_adr]
    base_w = mj_data.xmat[robot.base_body_id].reshape(3, 3)
    return mj_data.xaxis[joints] @ base_w
