"""A quadruped in the mirror: left and right exchanged.

A quadruped that is the same on both sides moves in the mirror as the mirrored robot
does: every step it takes tells of a second one. Mittal et al. 2024, "Symmetry
Considerations for Learning Task Symmetric Robot Policies", augment minibatches so.

Shapes: 48 numbers of an observation, 12 joints of an action, F feature columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import mujoco
import numpy as np
import torch
from torch import Tensor

from data.features import FEATURES, Feature
from policy.env.feature_row import OBSERVATION
from policy.robots.hints import RobotError
from policy.robots.robot import Robot

_SWAPPED = np.array([3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8])
"""Joint of the other side for every joint; legs are FR, FL, RR, RL."""
_TOLERANCE_RAD = 1e-3
_OTHER_FOOT = np.array([1, 0, 3, 2])
_VECTOR, _AXIAL = (1.0, -1.0, 1.0), (-1.0, 1.0, -1.0)
"""Signs of x forward, y left, z up of a velocity, and of a turning rate."""
_COMMAND = (1.0, -1.0, -1.0)

_SIGNS = {
    "base_lin_vel_b": _VECTOR,
    "base_ang_vel_b": _AXIAL,
    "gravity_b": _VECTOR,
    "command": _COMMAND,
}
"""Columns that stay where they are, and the signs they get."""
_OF_JOINTS = frozenset(
    {
        "joint_pos_offset",
        "joint_vel",
        "joint_torque",
        "action",
        "last_action",
        "action_rate",
    }
)
"""Columns of the twelve joints, which sides exchange, with the signs of the joints."""
_OF_FEET = frozenset({"foot_contact", "foot_height", "foot_speed", "foot_air_time"})
"""Columns of the four feet, which sides exchange."""
_OF_NO_SIDE = frozenset({"base_height", "fallen"})
"""Columns that are the same in the mirror."""


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
    row_idx: Tensor
    """[F] where each column of a feature row comes from."""
    row_sign: Tensor
    """[F]"""

    def to(self, device: torch.device) -> Mirror:
        """The same on `device`."""
        return Mirror(
            **{each.name: getattr(self, each.name).to(device) for each in fields(self)}
        )

    def obs(self, obs: Tensor) -> Tensor:
        """Observations [..., 48] of the mirrored robot."""
        return obs[..., self.obs_idx] * self.obs_sign

    def action(self, action: Tensor) -> Tensor:
        """Actions [..., 12] of the mirrored robot."""
        return action[..., self.joint_idx] * self.joint_sign

    def rows(self, features: Tensor) -> Tensor:
        """Feature rows [..., F] of the mirrored robot."""
        return features[..., self.row_idx] * self.row_sign


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
    obs_idx, obs_sign = mirrored(OBSERVATION, signs)
    row_idx, row_sign = mirrored(FEATURES, signs)
    return Mirror(
        obs_idx=torch.from_numpy(obs_idx),
        obs_sign=torch.from_numpy(obs_sign).float(),
        joint_idx=torch.from_numpy(_SWAPPED),
        joint_sign=torch.from_numpy(signs).float(),
        row_idx=torch.from_numpy(row_idx),
        row_sign=torch.from_numpy(row_sign).float(),
    )


def has_mirror(robot: Robot) -> bool:
    """Whether both sides of a robot are the same."""
    try:
        mirror_of(robot)
    except RobotError:
        return False
    return True


def mirrored(
    table: Sequence[Feature], joint_signs: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where the mirrored columns [D] of `table` come from, and their signs.

    Raises:
        ValueError: it has columns of which nobody said what the mirror makes of them.
    """
    idx, sign, start = [], [], 0
    for part in table:
        own, factor = np.arange(part.width), np.ones(part.width)
        if part.name in _OF_JOINTS:
            own, factor = _SWAPPED, joint_signs
        elif part.name in _OF_FEET:
            own = _OTHER_FOOT
        elif part.name in _SIGNS:
            factor = np.array(_SIGNS[part.name])
        elif part.name not in _OF_NO_SIDE:
            raise ValueError(
                "policy/training/mirror.py does not say what the mirror makes of "
                f"{part.name!r}"
            )
        if not len(own) == len(factor) == part.width:
            raise ValueError(
                f"the mirror makes {len(own)} columns of {part.name!r}, which has "
                f"{part.width}"
            )
        idx.append(start + own)
        sign.append(factor)
        start += part.width
    return np.concatenate(idx), np.concatenate(sign)


def _axes_b(robot: Robot) -> np.ndarray:
    """[12, 3] axes of the joints in the home pose, in the frame of the base."""
    mj_data = mujoco.MjData(robot.mj_model)
    mj_data.qpos[: len(robot.home_qpos)] = robot.home_qpos
    mujoco.mj_kinematics(robot.mj_model, mj_data)
    joints = robot.mj_model.dof_jntid[robot.qvel_adr]
    base_w = mj_data.xmat[robot.base_body_id].reshape(3, 3)
    return mj_data.xaxis[joints] @ base_w
