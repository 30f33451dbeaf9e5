"""Many copies of one robot, advanced together.

`Sim` is all the environment knows of a simulator; `BatchSim` runs MuJoCo on the CPU.

Shapes: N environments.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np
import torch
from mujoco.batch import Batch, SimulationError
from torch import Tensor

from data.features import LEGS
from policy.robots.bare import bare_model
from policy.robots.robot import Robot

logger = logging.getLogger(__name__)

_UNSTABLE = [
    int(mujoco.mjtWarning.mjWARN_BADQPOS),
    int(mujoco.mjtWarning.mjWARN_BADQVEL),
    int(mujoco.mjtWarning.mjWARN_BADQACC),
    int(mujoco.mjtWarning.mjWARN_BADCTRL),
]

_VEL = int(mujoco.mjtStage.mjSTAGE_VEL)


@dataclass(frozen=True, eq=False)
class SimState:
    """What the environment reads after a control step; float32 on the sim's device."""

    base_pos_w: Tensor
    """[N, 3] m"""
    base_wxyz_w: Tensor
    """[N, 4]"""
    base_lin_vel_w: Tensor
    """[N, 3] m/s"""
    base_ang_vel_b: Tensor
    """[N, 3] rad/s"""
    joint_pos: Tensor
    """[N, 12] rad"""
    joint_vel: Tensor
    """[N, 12] rad/s"""
    joint_torque: Tensor
    """[N, 12] N m, of the last physics step"""
    foot_pos_w: Tensor
    """[N, 4, 3] m, foot sites"""
    foot_vel_w: Tensor
    """[N, 4, 3] m/s"""
    foot_contact: Tensor
    """[N, 4] 0 or 1"""
    base_contact: Tensor
    """[N] 0 or 1"""
    base_height: Tensor
    """[N] m above the ground below it"""
    foot_height: Tensor
    """[N, 4] m, foot sites above the ground below them"""


class Sim(Protocol):
    """A simulator of N copies of one robot."""

    robot: Robot
    num_envs: int
    device: torch.device

    def set_targets(self, joint_pos: Tensor) -> None:
        """Joint positions [N, 12] the servos hold until the next call, rad."""
        ...

    def advance(self, substeps: int) -> Tensor:
        """Run physics; gives a mask [N] of simulations that went bad."""
        ...

    def read(self, ids: Tensor | None = None) -> SimState:
        """The current state, of simulations `ids` [K] alone if given."""
        ...

    def reset(self, ids: Tensor, qpos: Tensor, qvel: Tensor) -> None:
        """Put simulations `ids` [K] into the states `qpos` [K, nq], `qvel` [K, nv]."""
        ...

    def raw_state(self) -> tuple[np.ndarray, np.ndarray]:
        """Copies of qpos [N, nq] and qvel [N, nv] at full precision."""
        ...

    def snapshot(self) -> Tensor:
        """Everything needed to go on from here, float64 [N, S]."""
        ...

    def restore(self, snapshot: Tensor) -> None:
        """Go on from a `snapshot` of the same robot and number of environments."""
        ...


class BatchSim:
    """`Sim` on `mujoco.batch.Batch`: one simulation is one row of MuJoCo's state."""

    def __init__(self, robot: Robot, num_envs: int, *, threads: int = 0) -> None:
        """Make `num_envs` simulations on `threads` threads (0: all CPUs)."""
        # Without a handler MuJoCo writes MUJOCO_LOG.TXT into the working directory.
        mujoco.set_mju_user_warning(logger.debug)
        self.robot = robot
        self._ground = robot.ground
        self.num_envs = num_envs
        self.device = torch.device("cpu")
        self._mj_model = bare_model(robot.mjcf, robot.mj_model)
        self._batch = batch = Batch(self._mj_model, num_envs, threads)
        self._qpos, self._qvel = batch.bind("qpos"), batch.bind("qvel")
        self._ctrl = batch.bind("ctrl")
        self._torque = batch.bind("qfrc_actuator")
        self._sites = batch.bind("site_xpos")
        self._sensors = batch.bind("sensordata")
        contact = [_sensor_adr(robot, f"gaitpref_contact_{leg}") for leg in LEGS]
        self._contact_cols = _columns(np.array(contact))
        self._base_contact_col = _sensor_adr(robot, "gaitpref_contact_base")
        velocity = [_sensor_adr(robot, f"gaitpref_vel_{leg}") for leg in LEGS]
        self._velocity_cols = _columns(np.add.outer(velocity, np.arange(3)).ravel())
        self._qpos_cols = _columns(robot.qpos_adr)
        self._qvel_cols = _columns(robot.qvel_adr)
        self._site_cols = _columns(robot.foot_site_ids)
        self._ctrl_cols = _columns(robot.actuator_ids)
        joint = robot.mj_model.body_jntadr[robot.base_body_id]
        self._base_adr = (
            int(robot.mj_model.jnt_qposadr[joint]),
            int(robot.mj_model.jnt_dofadr[joint]),
        )
        batch.reset()
        self._initial = batch.state[0].copy()
        batch.forward(stage=_VEL)
        self._warned = self._warnings()

    def set_targets(self, joint_pos: Tensor) -> None:
        """See `Sim.set_targets`."""
        self._ctrl[:, self._ctrl_cols] = joint_pos.numpy()

    def advance(self, substeps: int) -> Tensor:
        """See `Sim.advance`; MuJoCo resets a diverged simulation without an error."""
        bad = torch.zeros(self.num_envs, dtype=torch.bool)
        try:
            # Decimation inside one call: five calls of one step cost 60 % more.
            self._batch.step(nstep=substeps, stage=_VEL)
        except SimulationError as error:
            bad[torch.from_numpy(np.asarray(error.ids, dtype=np.int64))] = True
        warned = self._warnings()
        bad |= torch.from_numpy(warned > self._warned)
        self._warned = warned
        return bad

    def read(self, ids: Tensor | None = None) -> SimState:
        """See `Sim.read`."""
        rows = slice(None) if ids is None else ids.numpy()
        exact = self._qpos[rows]
        qpos, qvel = exact.astype(np.float32), self._qvel[rows].astype(np.float32)
        sensors = self._sensors[rows].astype(np.float32)
        free, free_vel = self._base_adr
        base_w, feet_w = qpos[:, free : free + 3], self._sites[rows][:, self._site_cols]
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
            joint_pos=_tensor(qpos[:, self._qpos_cols]),
            joint_vel=_tensor(qvel[:, self._qvel_cols]),
            joint_torque=_tensor(self._torque[rows][:, self._qvel_cols]),
            foot_pos_w=_tensor(feet_w),
            foot_vel_w=_tensor(sensors[:, self._velocity_cols].reshape(-1, 4, 3)),
            foot_contact=_tensor(sensors[:, self._contact_cols] > 0),
            base_contact=_tensor(sensors[:, self._base_contact_col] > 0),
            base_height=_tensor(base_height),
            foot_height=_tensor(foot_height),
        )

    def reset(self, ids: Tensor, qpos: Tensor, qvel: Tensor) -> None:
        """See `Sim.reset`."""
        rows, batch = ids.numpy(), self._batch
        # What `batch.reset` leaves, without its scratch data: a third of the time.
        batch.state[rows], batch.warning[rows] = self._initial, 0
        self._qpos[rows], self._qvel[rows] = qpos.numpy(), qvel.numpy()
        self._ctrl[rows[:, None], self.robot.actuator_ids] = qpos.numpy()[
            :, self.robot.qpos_adr
        ]
        self._batch.forward(rows, stage=_VEL)
        self._warned = self._warnings()

    def raw_state(self) -> tuple[np.ndarray, np.ndarray]:
        """See `Sim.raw_state`."""
        return self._qpos.copy(), self._qvel.copy()

    def snapshot(self) -> Tensor:
        """See `Sim.snapshot`."""
        return torch.from_numpy(self._batch.state.copy())

    def restore(self, snapshot: Tensor) -> None:
        """See `Sim.restore`.

        Raises:
            ValueError: the snapshot is of another robot or number of environments.
        """
        if snapshot.shape != self._batch.state.shape:
            raise ValueError(
                f"the saved simulation state is {tuple(snapshot.shape)}, this robot "
                f"and number of environments need {self._batch.state.shape}"
            )
        self._batch.state[:] = snapshot.numpy()
        self._batch.forward(stage=_VEL)

    def _warnings(self) -> np.ndarray:
        """How often each simulation [N] was found unstable since its last reset."""
        return self._batch.warning[:, _UNSTABLE, 1].sum(axis=1)


def _sensor_adr(robot: Robot, name: str) -> int:
    return int(robot.mj_model.sensor(name).adr[0])


def _columns(ids: np.ndarray) -> slice | np.ndarray:
    """`ids` as a slice where they follow one another: views instead of copies."""
    first, count = int(ids[0]), len(ids)
    if (ids == np.arange(first, first + count)).all():
        return slice(first, first + count)
    return ids


def _tensor(values: np.ndarray) -> Tensor:
    """`values` as float32; a view of what is float32 already."""
    return torch.from_numpy(values.astype(np.float32, copy=False))
