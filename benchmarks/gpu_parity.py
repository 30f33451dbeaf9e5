"""Whether features on MuJoCo Warp are those of MuJoCo on the CPU.

A GPU computes with float32, which tells positions of a metre to 1e-7 m. Where a foot is
that near to touching at the end of a physics step, the last digits decide whether it
touches down in this step or in the next, and with what force. From there on two robots
part, be they of Warp and MuJoCo or of MuJoCo and itself, started as little apart. So
robots whose touchdowns no last digit decides are held to MuJoCo's features; how many
of all part is told, and how many of MuJoCo's own.

The second cause is the solver. The robot allows it 10 iterations, now and then too few
for four feet that land at once: MuJoCo was seen to stop 0.4 away from the velocities it
was after, Warp somewhere else. They are compared where both may go on to the end.

Shapes: N robots, T control steps, F feature columns.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import torch
from torch import Tensor

from data.features import column
from policy.env.env import QuadrupedEnv
from policy.env.feature_row import base_state
from policy.robots.robot import Robot, load_robot_xml

MOST_APART = 1e-3
"""Largest difference of a feature, as a share of one plus its size: torques of 20 N m
and joints of 10 rad/s have no more digits than others."""
DECIDED_M = 1e-6
"""What a foot does that is farther from touching is not decided by the last digits: its
height is a sum of about ten numbers that are told to 1e-7 m."""
ENOUGH_ITERATIONS = 100
"""More than either solver needs."""
Start = tuple[Tensor, Tensor]
"""qpos [N, nq] and qvel [N, nv]."""


@dataclass(frozen=True, eq=False)
class Run:
    """What robots did."""

    rows: Tensor
    """[T, N, F]"""
    nearest_m: Tensor
    """[N] least distance of a foot from beginning or ending to touch the ground, over
    all physics steps; 0 where nobody watched."""

    @property
    def decided(self) -> Tensor:
        """[N] whether no touchdown hangs on the last digits."""
        return self.nearest_m >= DECIDED_M

    def apart(self, other: Run) -> Tensor:
        """[T, N] largest difference of a feature from those of `other`, as a share of
        one plus its size there."""
        return ((self.rows - other.rows).abs() / (1 + other.rows.abs())).amax(dim=-1)

    def touches_alike(self, other: Run) -> Tensor:
        """[T, N] whether the same feet are on the ground."""
        feet = column("foot_contact")
        return (self.rows[..., feet] == other.rows[..., feet]).all(dim=-1)


def converging(robot: Robot) -> Robot:
    """`robot`, whose solver is never cut off."""
    spec = mujoco.MjSpec.from_string(robot.mjcf)
    spec.option.iterations = spec.option.ls_iterations = ENOUGH_ITERATIONS
    spec.compile()
    dt_s = float(robot.mj_model.opt.timestep)
    return load_robot_xml(spec.to_xml(), name=robot.name, physics_dt_s=dt_s)


@torch.inference_mode()
def run_of(
    env: QuadrupedEnv,
    start: Start,
    command: Tensor,
    actions: Tensor,
    *,
    watch: bool = False,
) -> Run:
    """What the robots of `env` do from `start` under `actions` [T, N, 12]; no episode
    ends. With `watch`, their feet are looked at after every physics step."""
    count, where = env.num_envs, env.device
    everyone = env.sim.rows(torch.ones(count, dtype=torch.bool, device=where))
    assert everyone is not None
    env.sim.reset(everyone, *(each.to(where) for each in start))
    env.command = command.to(where)
    env.action = torch.zeros(count, 12, device=where)
    env._air_time = torch.zeros(count, 4, device=where)
    nearest_m = torch.full((count,), torch.inf if watch else 0.0, device=where)
    rows: list[Tensor] = []
    parts = env.cfg.substeps if watch else 1
    for action in actions.to(where):
        previous, env.action = env.action, action
        env.sim.set_targets(env.targets(action))
        for _ in range(parts):
            env.sim.advance(env.cfg.substeps // parts)
            if watch:
                nearest_m = torch.minimum(nearest_m, _nearest_m(env))
        state = env.sim.read()
        rows.append(env._features(base_state(state), state, previous)[0].cpu())
    return Run(rows=torch.stack(rows), nearest_m=nearest_m.cpu())


def _nearest_m(env: QuadrupedEnv) -> Tensor:
    """Least distance [N] of a foot from where it begins to touch."""
    return (env.sim.read().foot_height - env._foot_radius).abs().amin(dim=-1)


def nudged(start: Start, by: float, *, rng: torch.Generator) -> Start:
    """`start` with all positions a little off: normal draws, `by` is their size."""
    qpos, qvel = start
    draws = torch.randn(qpos.shape, generator=rng, dtype=qpos.dtype)
    return qpos + by * draws, qvel
