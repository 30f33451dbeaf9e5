"""How robots of one model differ.

Shapes: N environments, K rows of values that are handed over.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import torch
from torch import Tensor

DRAWN = {
    "friction": 1,
    "mass": 1,
    "com_m": 3,
    "strength": 1,
    "delayed": 1,
    "encoder_bias_rad": 12,
}
"""Columns of what differs between robots, in their order."""
DRAWN_DIM = sum(DRAWN.values())


@dataclass(frozen=True, eq=False)
class Draw:
    """How robots differ, one row for each."""

    friction: Tensor
    """[K, 1] times that of the model"""
    mass: Tensor
    """[K, 1] times that of the model, inertia alike"""
    com_m: Tensor
    """[K, 3] shift of the base's centre of mass"""
    strength: Tensor
    """[K, 1] of gains and torque limits, times those of the model"""
    delayed: Tensor
    """[K, 1] 1 where targets arrive one control step late"""
    encoder_bias_rad: Tensor
    """[K, 12] what every joint's encoder adds to the angle"""

    @property
    def columns(self) -> Tensor:
        """[K, 19] all of it, in the order of `DRAWN`."""
        return torch.cat([getattr(self, name) for name in DRAWN], dim=-1)

    @staticmethod
    def of_columns(columns: Tensor) -> Draw:
        """The draws in `columns` [K, 19]."""
        parts = columns.split(list(DRAWN.values()), dim=-1)
        return Draw(**dict(zip(DRAWN, parts, strict=True)))

    @staticmethod
    def of_nobody(count: int, device: torch.device) -> Draw:
        """`count` robots that are the model itself."""
        columns = torch.zeros(count, DRAWN_DIM, device=device)
        nobody = Draw.of_columns(columns)
        for factor in (nobody.friction, nobody.mass, nobody.strength):
            factor.fill_(1.0)
        return nobody

    def arriving(self, joint_pos: Tensor, late: Tensor) -> Tensor:
        """What servos are told [K, 12]: `joint_pos`, or `late`, less the encoders'
        error."""
        told = torch.where(self.delayed > 0, late, joint_pos)
        return told - self.encoder_bias_rad


def varied_fields(mj_model: mujoco.MjModel) -> tuple[str, ...]:
    """Fields of the model that differ between robots."""
    names = ("geom_friction", "body_mass", "body_inertia", "body_ipos")
    names += ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange")
    return names + (("pair_friction",) if mj_model.npair else ())


def factors(mj_model: mujoco.MjModel, draw: Draw) -> dict[str, tuple[Tensor, slice]]:
    """Factor [K, 1] and columns of the fields that are a multiple of the model's."""
    everything = slice(None)
    found = {
        "geom_friction": (draw.friction, slice(0, 1)),
        "body_mass": (draw.mass, everything),
        "body_inertia": (draw.mass, everything),
        "actuator_gainprm": (draw.strength, everything),
        "actuator_biasprm": (draw.strength, everything),
        "actuator_forcerange": (draw.strength, everything),
    }
    if mj_model.npair:
        found["pair_friction"] = (draw.friction, slice(0, 2))
    return found
