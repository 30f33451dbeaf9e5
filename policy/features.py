"""From simulator state to observations and to the feature row.

Shapes: N environments, F feature columns.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from .sim import SimState

OBS_DIM = 48


@dataclass(frozen=True, eq=False)
class BaseState:
    """Motion of the base in its own frame."""

    lin_vel_b: Tensor
    """[N, 3] m/s"""
    ang_vel_b: Tensor
    """[N, 3] rad/s"""
    gravity_b: Tensor
    """[N, 3] unit vector, world down"""


# An entry of a rotation matrix is `unit + factor * (q_i q_j + sign * q_k q_l)`.
# One gather instead of forty operations on single components.
_FIRST = torch.tensor([10, 6, 7, 6, 5, 11, 7, 11, 5])
_SECOND = torch.tensor([15, 3, 2, 3, 15, 1, 2, 1, 10])
_SIGN = torch.tensor([1.0, -1, 1, 1, 1, -1, -1, 1, 1])
_FACTOR = torch.tensor([-2.0, 2, 2, 2, -2, 2, 2, 2, -2])
_UNIT = torch.eye(3).flatten()


def rotation_matrix(wxyz: Tensor) -> Tensor:
    """Body-to-world rotation [..., 3, 3] of unit quaternions [..., 4]."""
    products = (wxyz[..., :, None] * wxyz[..., None, :]).flatten(-2)
    sums = products[..., _FIRST] + _SIGN.to(wxyz) * products[..., _SECOND]
    return (_UNIT.to(wxyz) + _FACTOR.to(wxyz) * sums).unflatten(-1, (3, 3))


def base_state(state: SimState) -> BaseState:
    """Velocities and gravity in the body frame."""
    rotation = rotation_matrix(state.base_wxyz_w)
    return BaseState(
        lin_vel_b=(rotation * state.base_lin_vel_w[:, :, None]).sum(dim=1),
        ang_vel_b=state.base_ang_vel_b,
        gravity_b=-rotation[:, 2, :],
    )


def observation(
    base: BaseState,
    state: SimState,
    *,
    home_joint_pos: Tensor,
    action: Tensor,
    command: Tensor,
) -> Tensor:
    """What the policy sees, [N, 48]: proprioception, last action and command."""
    return torch.cat(
        (
            base.lin_vel_b,
            base.ang_vel_b,
            base.gravity_b,
            state.joint_pos - home_joint_pos,
            state.joint_vel,
            action,
            command,
        ),
        dim=-1,
    )


def feature_row(
    base: BaseState,
    state: SimState,
    *,
    home_joint_pos: Tensor,
    foot_radius: Tensor,
    command: Tensor,
    action: Tensor,
    previous_action: Tensor,
    foot_air_time: Tensor,
    fallen: Tensor,
) -> Tensor:
    """The row of `data.features.FEATURES`, [N, F] float32."""
    return torch.cat(
        (
            base.lin_vel_b,
            base.ang_vel_b,
            base.gravity_b,
            state.base_height[:, None],
            command,
            state.joint_pos - home_joint_pos,
            state.joint_vel,
            state.joint_torque,
            action,
            action - previous_action,
            state.foot_contact,
            state.foot_height - foot_radius,
            torch.linalg.vector_norm(state.foot_vel_w[:, :, :2], dim=-1),
            foot_air_time,
            fallen[:, None].to(torch.float32),
        ),
        dim=-1,
    )
