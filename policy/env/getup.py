"""Getting up: a fallen robot is a task and not only an end.

Episodes begin in poses that robots came to rest in after a fall, and no fall ends
them. What is paid for is in `TaskRewardCfg`, like all the task pays.

Shapes: P poses, K robots that start, nq positions of the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import torch
from torch import Tensor

from policy.robots.robot import Robot, load_robot_xml
from policy.robots.solid import make_legs_solid
from policy.sim.batch_sim import BatchSim
from policy.sim.chosen import Listed
from policy.sim.field import Field

from .terrain import Starts

_LIMP = 4
"""Physics steps between two targets of a limp joint."""


@dataclass(frozen=True, kw_only=True)
class GetupCfg:
    """How robots come to lie where they lie."""

    drops: int = 256
    """Robots that are dropped when an environment is made; episodes begin in the poses
    of those that came to lie."""
    drop_m: float = 0.1
    """Height they are dropped from, above that of standing."""
    settle_s: float = 1.5
    """Time they have to come to rest, limp."""
    lying_cosine: float = 0.5
    """Cosine of the tilt below which a robot lies."""
    lying_ratio: float = 0.5
    """Height of the base, as a share of that of standing, below which it lies as well,
    though level."""


class Lying:
    """Poses of robots that came to lie."""

    def __init__(
        self, robot: Robot, cfg: GetupCfg, *, seed: int, device: torch.device
    ) -> None:
        """Drop robots, on the CPU, and keep those that lie, on `device`.

        Raises:
            ValueError: none of them does.
        """
        rng = torch.Generator().manual_seed(seed)
        sim = BatchSim(robot, cfg.drops)
        at_rest = torch.zeros(cfg.drops, robot.mj_model.nv, dtype=torch.float64)
        everyone = Listed(torch.arange(cfg.drops))
        sim.reset(everyone, _dropped(robot, cfg, rng), at_rest)
        bad = torch.zeros(cfg.drops, dtype=torch.bool)
        for _ in range(round(cfg.settle_s / robot.mj_model.opt.timestep / _LIMP)):
            # Servos that follow hold nothing: the motors are off.
            sim.set_targets(sim.read().joint_pos)
            bad |= sim.advance(_LIMP)
        state = sim.read()
        x, y = state.base_wxyz_w[:, 1:3].unbind(-1)
        turned_over = 1 - 2 * (x * x + y * y) < cfg.lying_cosine
        low = state.base_height < cfg.lying_ratio * float(robot.home_qpos[2])
        self.qpos = sim.raw_state()[0][~bad & (turned_over | low)].to(device)
        """[P, nq]"""
        if not len(self.qpos):
            raise ValueError(f"none of {cfg.drops} robots came to lie when dropped")

    def draw(self, count: int, rng: torch.Generator) -> Tensor:
        """Poses [K, nq] of `count` of them."""
        poses = len(self.qpos)
        chosen = torch.randint(poses, (count,), generator=rng, device=self.qpos.device)
        return self.qpos[chosen]


def _dropped(robot: Robot, cfg: GetupCfg, rng: torch.Generator) -> Tensor:
    """States [P, nq] in the air, turned anyhow, with joints up to 1 rad from home."""
    count = cfg.drops
    qpos = torch.from_numpy(robot.home_qpos.copy()).repeat(count, 1)
    if robot.ground is not None:
        Starts(robot, Field(robot.ground, qpos.device)).place(
            qpos, lambda *shape: 2 * torch.rand(shape, generator=rng) - 1
        )
    qpos[:, 2] += cfg.drop_m
    wxyz = torch.randn(count, 4, generator=rng, dtype=torch.float64)
    qpos[:, 3:7] = wxyz / wxyz.norm(dim=-1, keepdim=True)
    home = torch.tensor(robot.home_joint_pos)
    low, high = torch.tensor(robot.joint_range).unbind(-1)
    low, high = torch.maximum(low, home - 1), torch.minimum(high, home + 1)
    share = torch.rand(count, 12, generator=rng, dtype=torch.float64)
    qpos[:, torch.tensor(robot.qpos_adr)] = low + share * (high - low)
    return qpos


def with_solid_legs(robot: Robot) -> Robot:
    """`robot` with thighs and shanks that touch the ground, where they did not."""
    spec = mujoco.MjSpec.from_string(robot.mjcf)
    mj_model = spec.compile()
    joints = [
        int(np.flatnonzero(mj_model.jnt_qposadr == adr)[0]) for adr in robot.qpos_adr
    ]
    if not make_legs_solid(spec, mj_model, robot.home_qpos, joints):
        return robot
    return load_robot_xml(
        spec.to_xml(), name=robot.name, physics_dt_s=mj_model.opt.timestep
    )
