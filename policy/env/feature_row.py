"""From simulator state to observations and to the feature row.

Shapes: N environments, F feature columns.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import torch
from torch import Tensor

from data.features import FEATURES, Feature
from policy.sim.sim import SimState

OBSERVATION = (
    Feature("base_lin_vel_b", 3, "m/s", "velocity of the base in its own frame"),
    Feature("base_ang_vel_b", 3, "rad/s", "turning rates of the base in its own frame"),
    Feature("gravity_b", 3, "1", "unit vector, world down in the frame of the base"),
    Feature("joint_pos_offset", 12, "rad", "angles less home_joint_pos_rad"),
    Feature("joint_vel", 12, "rad/s", "angular velocities of the joints"),
    Feature(
        "last_action", 12, "1", "the action before, clipped to action_limit; 0 at first"
    ),
    Feature(
        "command", 3, "m/s, m/s, rad/s", "forward, left and turning speed asked for"
    ),
)
"""The columns of what a policy sees, in their order."""

OBS_DIM = sum(part.width for part in OBSERVATION)


def obs_column(name: str) -> slice:
    """The slice of the last axis of observations [..., 48] that holds `name`.

    Raises:
        ValueError: there is no such part.
    """
    start = 0
    for part in OBSERVATION:
        if part.name == name:
            return slice(start, start + part.width)
        start += part.width
    known = ", ".join(part.name for part in OBSERVATION)
    raise ValueError(f"an observation has no part {name!r}; there are: {known}")


def in_order(parts: Mapping[str, Tensor], table: Sequence[Feature]) -> Tensor:
    """The columns [..., D] of `table`, each out of `parts` by its name.

    Raises:
        ValueError: the parts are not those of the table, by name or by width.
    """
    if len(parts) != len(table) or any(
        part.name not in parts or parts[part.name].shape[-1] != part.width
        for part in table
    ):
        found = ", ".join(f"{name} {part.shape[-1]}" for name, part in parts.items())
        wanted = ", ".join(f"{part.name} {part.width}" for part in table)
        raise ValueError(f"the columns are {found}; the table says {wanted}")
    return torch.cat([parts[part.name] for part in table], dim=-1)


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
    first, second, sign, factor, unit = _entries(wxyz.device, wxyz.dtype)
    products = (wxyz[..., :, None] * wxyz[..., None, :]).flatten(-2)
    sums = products[..., first] + sign * products[..., second]
    return (unit + factor * sums).unflatten(-1, (3, 3))


@cache
def _entries(device: torch.device, dtype: torch.dtype) -> tuple[Tensor, ...]:
    """The constants of `rotation_matrix` where they are needed: copied once."""
    # What is made in inference mode could not be used outside it.
    with torch.inference_mode(False):
        ids = (_FIRST.to(device), _SECOND.to(device))
        return (*ids, *(each.to(device, dtype) for each in (_SIGN, _FACTOR, _UNIT)))


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
    parts = {
        "base_lin_vel_b": base.lin_vel_b,
        "base_ang_vel_b": base.ang_vel_b,
        "gravity_b": base.gravity_b,
        "joint_pos_offset": state.joint_pos - home_joint_pos,
        "joint_vel": state.joint_vel,
        "last_action": action,
        "command": command,
    }
    return in_order(parts, OBSERVATION)


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
    parts = {
        "base_lin_vel_b": base.lin_vel_b,
        "base_ang_vel_b": base.ang_vel_b,
        "gravity_b": base.gravity_b,
        "base_height": state.base_height[:, None],
        "command": command,
        "joint_pos_offset": state.joint_pos - home_joint_pos,
        "joint_vel": state.joint_vel,
        "joint_torque": state.joint_torque,
        "action": action,
        "action_rate": action - previous_action,
        "foot_contact": state.foot_contact,
        "foot_height": state.foot_height - foot_radius,
        "foot_speed": torch.linalg.vector_norm(state.foot_vel_w[:, :, :2], dim=-1),
        "foot_air_time": foot_air_time,
        "fallen": fallen[:, None].to(torch.float32),
    }
    return in_order(parts, FEATURES)
