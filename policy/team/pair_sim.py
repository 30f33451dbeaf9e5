"""Teams of two behind `Sim`: robots 2i and 2i + 1 are in one MuJoCo world.

To everything above they are robots like others, each with a state of its own.

Shapes: N robots, W = N / 2 worlds, K robots that are listed, nq and nv of one robot.
"""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import torch
from torch import Tensor

from policy.robots.robot import Robot
from policy.sim.addresses import addresses_of
from policy.sim.batch_sim import VEL, BatchSim
from policy.sim.chosen import Listed, Rows, listed
from policy.sim.sim import SimError, SimState

from .pair_model import MATE, pair_of


class PairSim(BatchSim):
    """`Sim` of N robots, two and two in one of N / 2 worlds of MuJoCo's batch."""

    def __init__(self, robot: Robot, num_envs: int, *, threads: int = 0) -> None:
        """Make the worlds of `num_envs` robots on `threads` threads, as of
        `BatchSim`."""
        if num_envs % 2:
            raise SimError(f"teams of two need an even number of robots: {num_envs}")
        first, second = pair_of(robot)
        super().__init__(first, num_envs // 2, threads=threads)
        self.mjcf = first.mjcf
        """The world of both, which an episode keeps."""
        self.num_envs = num_envs
        self._seats = (addresses_of(first), addresses_of(second, MATE))
        self._motors = (first.actuator_ids, second.actuator_ids)
        nq, nv = robot.mj_model.nq, robot.mj_model.nv
        self._own_qpos = (slice(0, nq), slice(nq, 2 * nq))
        self._own_qvel = (slice(0, nv), slice(nv, 2 * nv))

    def rows(self, mask: Tensor) -> Rows | None:
        """See `Sim.rows`; of a team that is listed, both are."""
        return listed(mask.view(-1, 2).any(dim=1).repeat_interleave(2))

    def set_targets(self, joint_pos: Tensor) -> None:
        """See `Sim.set_targets`."""
        for seat, at in enumerate(self._seats):
            self._ctrl[:, at.ctrl] = joint_pos[seat::2].numpy()

    def advance(self, substeps: int) -> Tensor:
        """See `Sim.advance`; a world that diverged is bad for both."""
        return super().advance(substeps).repeat_interleave(2)

    def read(self, rows: Rows | None = None) -> SimState:
        """See `Sim.read`."""
        chosen = slice(None) if rows is None else _worlds(rows)
        both = [self._seen(at, chosen) for at in self._seats]
        return SimState(
            **{
                item.name: torch.stack(
                    [getattr(seat, item.name) for seat in both], dim=1
                ).flatten(0, 1)
                for item in fields(SimState)
            }
        )

    def reset(self, rows: Rows, qpos: Tensor, qvel: Tensor) -> None:
        """See `Sim.reset`; both robots of a team at once, one behind the other."""
        worlds, batch = _worlds(rows), self._batch
        batch.state[worlds], batch.warning[worlds] = self._initial, 0
        for seat, motors in enumerate(self._motors):
            own = qpos[seat::2].numpy()
            self._qpos[worlds, self._own_qpos[seat]] = own
            self._qvel[worlds, self._own_qvel[seat]] = qvel[seat::2].numpy()
            # Where the joints are in the world, less where the robot begins in it.
            joints = np.arange(own.shape[1])[self._seats[0].qpos]
            self._ctrl[worlds[:, None], motors] = own[:, joints]
        batch.forward(worlds, stage=VEL)
        self._warned = self._warnings()

    def raw_state(self) -> tuple[Tensor, Tensor]:
        """See `Sim.raw_state`."""
        qpos, qvel = super().raw_state()
        return qpos.view(self.num_envs, -1), qvel.view(self.num_envs, -1)


def _worlds(rows: Rows) -> np.ndarray:
    """The worlds of robots that are listed team by team."""
    assert isinstance(rows, Listed)
    return rows.ids[::2].numpy() // 2
