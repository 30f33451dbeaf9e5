"""Worlds of MuJoCo Warp: how much room each needs, and how many fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass

import mujoco
import mujoco_warp as mjw
import numpy as np
import torch
import warp as wp

from .device_memory import too_many
from .sim import SimError

_GEOM = mujoco.mjtGeom
_CONTACTS = {
    int(_GEOM.mjGEOM_SPHERE): 1,
    int(_GEOM.mjGEOM_CAPSULE): 2,
    int(_GEOM.mjGEOM_ELLIPSOID): 1,
}
"""Contacts of a shape with a plane, where they are fewer than four."""
_ON_FIELD = 8
"""Contacts of any shape with ground that is not flat."""
_MOST = 256
_AMONG_LEGS = 16
"""Contacts of the robot with itself that there is room for."""
_LEARNING = 200_000
"""Bytes a world takes beside physics: observations, feature rows and rollout."""


@dataclass(frozen=True)
class Capacity:
    """Room in every world; what finds none is lost, and the world goes bad."""

    contacts: int
    constraints: int


def capacity_of(mj_model: mujoco.MjModel) -> Capacity:
    """Room for every part of the robot on the ground at once."""
    grounded = mj_model.body_weldid[mj_model.geom_bodyid] == 0
    collides = (mj_model.geom_contype | mj_model.geom_conaffinity) != 0
    own = np.flatnonzero(~grounded & collides)
    field = bool((mj_model.geom_type[grounded] == _GEOM.mjGEOM_HFIELD).any())
    each = [
        _ON_FIELD if field else _CONTACTS.get(int(mj_model.geom_type[geom]), 4)
        for geom in own
    ]
    affine = mj_model.geom_contype[own, None] & mj_model.geom_conaffinity[None, own]
    itself = bool((affine | affine.T).any()) or mj_model.npair > 0
    contacts = min(_MOST, sum(each) + _AMONG_LEGS * itself)
    condim = int(mj_model.geom_condim.max())
    rows = contacts * max(1, 2 * (condim - 1))
    rows += int(mj_model.jnt_limited.sum()) + int((mj_model.dof_frictionloss > 0).sum())
    rows += 6 * mj_model.neq + 2 * mj_model.ntendon
    # Rounded up, so that kernels are shared between robots.
    return Capacity(contacts=-(-contacts // 8) * 8, constraints=-(-rows // 16) * 16)


def made_worlds(
    mj_model: mujoco.MjModel, num_envs: int, *, device: str, own: tuple[str, ...] = ()
) -> tuple[mjw.Model, mjw.Data]:
    """A model and `num_envs` worlds on `device`.

    Args:
        mj_model: The model.
        num_envs: How many worlds.
        device: `cpu` or as `cuda:0`.
        own: Fields of the model that every world has for itself.

    Raises:
        SimError: the model has parts that MuJoCo Warp does not know.
        DeviceMemoryError: the worlds do not fit.
    """
    room = capacity_of(mj_model)

    def made(count: int) -> tuple[mjw.Model, mjw.Data]:
        model = mjw.put_model(mj_model, batch_sizes=dict.fromkeys(own, count))
        data = mjw.make_data(
            mj_model, count, nconmax=room.contacts, njmax=room.constraints
        )
        # What is lost is told by `Data.overflow`; printing it would slow a GPU down.
        model.opt.warn_overflow = 0
        return model, data

    with wp.ScopedDevice(device):
        try:
            if device != "cpu":
                require_room(num_envs, made)
            return made(num_envs)
        except NotImplementedError as error:
            raise SimError(
                f"MuJoCo Warp does not simulate this robot: {error} Use --sim threads"
            ) from None


def require_room(num_envs: int, made: Callable[[int], object]) -> None:
    """Stop before the memory of the GPU is used up.

    Raises:
        DeviceMemoryError: it would be, and how many worlds fit.
    """
    few, more = (_bytes_of(made(count)) for count in (8, 16))
    physics = (more - few) / 8
    each, shared = physics + _LEARNING, few - 8 * physics
    free, _ = torch.cuda.mem_get_info()
    fit = int((0.9 * free - shared) / each)
    if num_envs > fit:
        raise too_many(num_envs, fit)


def _bytes_of(record: object) -> int:
    """Memory of all arrays in a record of records."""
    if isinstance(record, wp.array):
        return record.capacity
    if isinstance(record, (tuple, list)):
        return sum(map(_bytes_of, record))
    if is_dataclass(record):
        return sum(_bytes_of(getattr(record, each.name)) for each in fields(record))
    return 0
