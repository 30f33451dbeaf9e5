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


def rotation_matrix(wxyz: Tensor) -> Tensor:
    """Body-to-world rotation [..., 3, 3] of unit quaternions [..., 4]."""
    w, x, y, z = wxyz.unbind(-1)
    rows = (
        torch.stack(
            (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y))
        ),
        torch.stack(
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x))
        ),
        torch.stack(
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y))
        ),
    )
    return torch.stack(rows).movedim((0, 1), (-2, -1))


def base_state(state: SimState) -> BaseState:
    """Velocities and gravity in the body frame."""
    rotation = rotation_matrix(state.base_wxyz_w)
    return BaseState(
        lin_vel_b=torch.einsum("nwb,nw->nb", rotation, state.base_lin_vel_w),
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
