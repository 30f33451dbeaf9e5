"""MuJoCo on the CPU behind `Sim`.

Shapes: N environments, K of them that are listed.
"""

from __future__ import annotations

import logging

import mujoco
import numpy as np
import torch
from mujoco.batch import Batch, SimulationError
from torch import Tensor

from policy.parallel.cores import cores
from policy.robots.bare import bare_model
from policy.robots.robot import Robot

from .addresses import Addresses, addresses_of
from .chosen import Listed, Rows, listed
from .draw import Draw, factors, varied_fields
from .sim import SimState, require_fits

logger = logging.getLogger(__name__)

_UNSTABLE = [
    int(mujoco.mjtWarning.mjWARN_BADQPOS),
    int(mujoco.mjtWarning.mjWARN_BADQVEL),
    int(mujoco.mjtWarning.mjWARN_BADQACC),
    int(mujoco.mjtWarning.mjWARN_BADCTRL),
]

VEL = int(mujoco.mjtStage.mjSTAGE_VEL)
"""How far a step computes: all that is read of it, and no sensor of accelerations."""


class BatchSim:
    """`Sim` on `mujoco.batch.Batch`: one simulation is one row of MuJoCo's state."""

    def __init__(self, robot: Robot, num_envs: int, *, threads: int = 0) -> None:
        """Make `num_envs` simulations on `threads` threads, by default one for
        each core this process has."""
        # Without a handler MuJoCo writes MUJOCO_LOG.TXT into the working directory.
        mujoco.set_mju_user_warning(logger.debug)
        self.robot = robot
        self._ground = robot.ground
        self.num_envs = num_envs
        self.device = torch.device("cpu")
        self._mj_model = bare_model(robot.mjcf, robot.mj_model)
        self._batch = batch = Batch(self._mj_model, num_envs, threads or cores())
        self._qpos, self._qvel = batch.bind("qpos"), batch.bind("qvel")
        self._ctrl = batch.bind("ctrl")
        self._torque = batch.bind("qfrc_actuator")
        self._sites = batch.bind("site_xpos")
        self._sensors = batch.bind("sensordata")
        self._at = addresses_of(robot)
        batch.reset()
        self._initial = batch.state[0].copy()
        batch.forward(stage=VEL)
        self._warned = self._warnings()

    def rows(self, mask: Tensor) -> Rows | None:
        """See `Sim.rows`."""
        return listed(mask)

    def set_targets(self, joint_pos: Tensor) -> None:
        """See `Sim.set_targets`."""
        self._ctrl[:, self._at.ctrl] = joint_pos.numpy()

    def advance(self, substeps: int) -> Tensor:
        """See `Sim.advance`; MuJoCo resets a diverged simulation without an error."""
        bad = torch.zeros(len(self._warned), dtype=torch.bool)
        try:
            # Decimation inside one call: five calls of one step cost 60 % more.
            self._batch.step(nstep=substeps, stage=VEL)
        except SimulationError as error:
            bad[torch.from_numpy(np.asarray(error.ids, dtype=np.int64))] = True
        warned = self._warnings()
        bad |= torch.from_numpy(warned > self._warned)
        self._warned = warned
        return bad

    def read(self, rows: Rows | None = None) -> SimState:
        """See `Sim.read`."""
        return self._seen(self._at, slice(None) if rows is None else _ids(rows))

    def _seen(self, at: Addresses, chosen: slice | np.ndarray) -> SimState:
        """The state of the robot at `at` in the simulations `chosen` [K]."""
        exact = self._qpos[chosen]
        qpos, qvel = exact.astype(np.float32), self._qvel[chosen].astype(np.float32)
        sensors = self._sensors[chosen].astype(np.float32)
        free, free_vel = at.base_qpos, at.base_qvel
        base_w, feet_w = qpos[:, free : free + 3], self._sites[chosen][:, at.sites]
        base_height, foot_height = base_w[:, 2], feet_w[:, :, 2]
        if self._ground is not None:
            base_w = exact[:, free : free + 3]
            base_height = base_w[:, 2] - self._ground.height_m(base_w[:, :2])
            foot_height = foot_height - self._ground.height_m(feet_w[:, :, :2])
        return SimState(
            base_pos_w=_tensor(base_w),
            base_wxyz_w=_tensor(qpos[:, free + 3 : free + 7]),
            base_lin_vel_w=_tensor(qvel[:, free_vel : free_vel + 3]),
            base_ang_vel_b=_tensor(qvel[:, free_vel + 3 : free_vel + 6]),
            joint_pos=_tensor(qpos[:, at.qpos]),
            joint_vel=_tensor(qvel[:, at.qvel]),
            joint_torque=_tensor(self._torque[chosen][:, at.qvel]),
            foot_vel_w=_tensor(sensors[:, at.velocity].reshape(-1, 4, 3)),
            foot_contact=_tensor(sensors[:, at.contact] > 0),
            base_contact=_tensor(sensors[:, at.base_contact] > 0),
            base_height=_tensor(base_height),
            foot_height=_tensor(foot_height),
        )

    def reset(self, rows: Rows, qpos: Tensor, qvel: Tensor) -> None:
        """See `Sim.reset`."""
        ids, batch = _ids(rows), self._batch
        # What `batch.reset` leaves, without its scratch data: a third of the time.
        batch.state[ids], batch.warning[ids] = self._initial, 0
        self._qpos[ids], self._qvel[ids] = qpos.numpy(), qvel.numpy()
        self._ctrl[ids[:, None], self.robot.actuator_ids] = qpos.numpy()[
            :, self.robot.qpos_adr
        ]
        self._batch.forward(ids, stage=VEL)
        self._warned = self._warnings()

    def raw_state(self) -> tuple[Tensor, Tensor]:
        """See `Sim.raw_state`."""
        qpos, qvel = self._qpos.copy(), self._qvel.copy()
        return torch.from_numpy(qpos), torch.from_numpy(qvel)

    def snapshot(self) -> Tensor:
        """See `Sim.snapshot`."""
        return torch.from_numpy(self._batch.state.copy())

    def restore(self, snapshot: Tensor) -> None:
        """See `Sim.restore`."""
        require_fits(snapshot, self._batch.state.shape)
        self._batch.state[:] = snapshot.numpy()
        self._batch.forward(stage=VEL)

    def _warnings(self) -> np.ndarray:
        """How often each simulation [N] was found unstable since its last reset."""
        return self._batch.warning[:, _UNSTABLE, 1].sum(axis=1)


class VariedBatchSim(BatchSim):
    """MuJoCo on the CPU, with fields of the model that differ between simulations."""

    def __init__(self, robot: Robot, num_envs: int, *, threads: int = 0) -> None:
        """See `BatchSim`."""
        super().__init__(robot, num_envs, threads=threads)
        mj_model, batch = self._mj_model, self._batch
        self._nominal = {
            name: getattr(mj_model, name).copy() for name in varied_fields(mj_model)
        }
        self._fields = {name: batch.expand(name) for name in self._nominal}
        self.draw = Draw.of_nobody(num_envs, self.device)
        self._home = torch.tensor(robot.home_joint_pos, dtype=torch.float32)
        self.late_targets = self._home.repeat(num_envs, 1)

    def vary(self, rows: Rows, draw: Draw) -> None:
        """See `VariedSim.vary`."""
        columns = self.draw.columns
        rows.put(columns, draw.columns)
        self.draw = Draw.of_columns(columns)
        ids, nominal, fields = _ids(rows), self._nominal, self._fields
        for name, (factor, columns) in factors(self._mj_model, draw).items():
            value = nominal[name][..., columns]
            shape = (len(ids), *([1] * value.ndim))
            fields[name][ids, ..., columns] = (
                factor.double().numpy().reshape(shape) * value
            )
        base = self.robot.base_body_id
        fields["body_ipos"][ids, base] = nominal["body_ipos"][base] + draw.com_m.numpy()
        self._batch.set_const(ids)

    def set_targets(self, joint_pos: Tensor) -> None:
        """See `Sim.set_targets`; encoders lie to servos as they do to the policy."""
        arriving = self.draw.arriving(joint_pos, self.late_targets)
        self.late_targets = joint_pos.clone()
        super().set_targets(arriving)

    def reset(self, rows: Rows, qpos: Tensor, qvel: Tensor) -> None:
        """See `Sim.reset`."""
        super().reset(rows, qpos, qvel)
        rows.put(self.late_targets, self._home)

    def push(self, rows: Rows, velocity_m_s: Tensor) -> None:
        """See `VariedSim.push`."""
        first = self._at.base_qvel
        self._qvel[_ids(rows), first : first + 2] += velocity_m_s.numpy()


def _ids(rows: Rows) -> np.ndarray:
    assert isinstance(rows, Listed)
    return rows.ids.numpy()


def _tensor(values: np.ndarray) -> Tensor:
    """`values` as float32; a view of what is float32 already."""
    return torch.from_numpy(values.astype(np.float32, copy=False))
