"""MuJoCo Warp behind `Sim`: one kernel for all worlds, on an NVIDIA GPU or, to be
tested, on Warp's CPU device.

What Warp promises of equal runs: on its CPU device they are equal to the last bit. On a
GPU sums are added in the order in which threads come, so that two runs from one seed
part in the last digits and, contact by contact, in all of them; which gaits are learned
differs no more than between two seeds.

Shapes: N environments (worlds of MuJoCo Warp).
"""

from __future__ import annotations

import mujoco_warp as mjw
import torch
import warp as wp
from torch import Tensor

from policy.robots.bare import bare_model
from policy.robots.robot import Robot

from .addresses import Columns, addresses_of
from .chosen import Masked, Rows
from .field import Field
from .sim import SimState, require_fits
from .warp_graphs import Graphs
from .warp_memory import made_worlds

_LARGEST = 1e10
"""A position, velocity or acceleration beyond this has diverged, as MuJoCo sees it."""


class WarpSim:
    """`Sim` on `mujoco_warp`; every call works on all worlds at once."""

    def __init__(self, robot: Robot, num_envs: int, *, device: str = "cpu") -> None:
        """Make `num_envs` worlds on `device`, `cpu` or as `cuda:0`.

        Raises:
            SimError: the robot has parts that MuJoCo Warp does not know.
            DeviceMemoryError: so many worlds do not fit.
        """
        self.robot = robot
        self.num_envs = num_envs
        self.device = torch.device(device)
        self._mj_model = bare_model(robot.mjcf, robot.mj_model)
        self._ground = robot.ground and Field(robot.ground, self.device)
        self._at = addresses_of(robot)
        self._cols = {
            name: _columns(getattr(self._at, name), self.device)
            for name in ("qpos", "qvel", "ctrl", "sites", "contact", "velocity")
        }
        self._model, self._data = made_worlds(
            self._mj_model, num_envs, device=device, own=self._own_fields()
        )
        self._bind()
        self._graphs = Graphs(self._model, self._data, device)
        self._graphs.compile()
        everyone = Masked(torch.ones(num_envs, dtype=torch.bool, device=self.device))
        home = torch.from_numpy(self._mj_model.qpos0.copy()).to(self.device)
        at_rest = torch.zeros_like(self._qvel)
        WarpSim.reset(self, everyone, home.repeat(num_envs, 1), at_rest)

    def _own_fields(self) -> tuple[str, ...]:
        """Fields of the model that every world has for itself."""
        return ()

    def _bind(self) -> None:
        """Look at the worlds' arrays as tensors, without a copy."""
        data = self._data
        self._qpos, self._qvel = wp.to_torch(data.qpos), wp.to_torch(data.qvel)
        self._ctrl = wp.to_torch(data.ctrl)
        self._qacc, self._time = wp.to_torch(data.qacc), wp.to_torch(data.time)
        self._warmstart = wp.to_torch(data.qacc_warmstart)
        self._torque = wp.to_torch(data.qfrc_actuator)
        self._sites = wp.to_torch(data.site_xpos)
        self._sensors = wp.to_torch(data.sensordata)
        self._overflow = wp.to_torch(data.overflow)
        self._act = wp.to_torch(data.act)

    def rows(self, mask: Tensor) -> Rows | None:
        """See `Sim.rows`; how many they are is not asked."""
        return Masked(mask)

    def set_targets(self, joint_pos: Tensor) -> None:
        """See `Sim.set_targets`."""
        self._ctrl[:, self._cols["ctrl"]] = joint_pos

    def advance(self, substeps: int) -> Tensor:
        """See `Sim.advance`.

        A world whose contacts found no room has gone bad too: its robot fell through
        the ground.
        """
        self._bring_up_to_date()
        self._graphs.step(substeps)
        state = torch.cat((self._qpos, self._qvel, self._qacc), dim=-1)
        # Of what is no number no comparison holds.
        sound = (state.abs() <= _LARGEST).all(dim=-1)
        bad = ~sound | (self._overflow & _LOST != 0)
        self._overflow.zero_()
        return bad

    def read(self, rows: Rows | None = None) -> SimState:
        """See `Sim.read`; all worlds are read, whichever are asked for."""
        self._bring_up_to_date()
        at, cols = self._at, self._cols
        free, free_vel = at.base_qpos, at.base_qvel
        base_w = self._qpos[:, free : free + 3].clone()
        feet_w = self._sites[:, cols["sites"]].clone()
        base_height, foot_height = base_w[:, 2], feet_w[:, :, 2]
        if self._ground is not None:
            base_height = base_height - self._above(base_w)
            foot_height = foot_height - self._above(feet_w)
        sensors, joints = self._sensors, cols["qvel"]
        return SimState(
            base_pos_w=base_w,
            base_wxyz_w=self._qpos[:, free + 3 : free + 7].clone(),
            base_lin_vel_w=self._qvel[:, free_vel : free_vel + 3].clone(),
            base_ang_vel_b=self._qvel[:, free_vel + 3 : free_vel + 6].clone(),
            joint_pos=self._qpos[:, cols["qpos"]].clone(),
            joint_vel=self._qvel[:, joints].clone(),
            joint_torque=self._torque[:, joints].clone(),
            foot_vel_w=sensors[:, cols["velocity"]].reshape(-1, 4, 3).clone(),
            foot_contact=(sensors[:, cols["contact"]] > 0).float(),
            base_contact=(sensors[:, at.base_contact] > 0).float(),
            base_height=base_height,
            foot_height=foot_height,
        )

    def _above(self, points_w: Tensor) -> Tensor:
        """Height [...] of the ground below `points_w` [..., 3]."""
        assert self._ground is not None
        return self._ground.height_m(points_w[..., :2].double()).float()

    def reset(self, rows: Rows, qpos: Tensor, qvel: Tensor) -> None:
        """See `Sim.reset`."""
        rows.put(self._qpos, qpos)
        rows.put(self._qvel, qvel)
        rows.put(self._ctrl, self._home_ctrl(qpos))
        for left in (self._qacc, self._warmstart, self._time, self._act, self._torque):
            rows.put(left, 0.0)
        self._current = False

    def _bring_up_to_date(self) -> None:
        """Compute what follows from a state that was set."""
        if not self._current:
            self._graphs.forward()
            self._current = True

    def _home_ctrl(self, qpos: Tensor) -> Tensor:
        """Targets [K, nu] that hold the angles of `qpos` [K, nq]."""
        ctrl = torch.zeros(len(qpos), self._ctrl.shape[1], device=self.device)
        ctrl[:, self._cols["ctrl"]] = qpos[:, self._cols["qpos"]].float()
        return ctrl

    def raw_state(self) -> tuple[Tensor, Tensor]:
        """See `Sim.raw_state`; what a GPU computes is float32."""
        return self._qpos.double(), self._qvel.double()

    def snapshot(self) -> Tensor:
        """See `Sim.snapshot`."""
        parts = [part.double() for part in self._parts()]
        return torch.cat(parts, dim=-1)

    def restore(self, snapshot: Tensor) -> None:
        """See `Sim.restore`."""
        parts = self._parts()
        widths = [part.shape[1] for part in parts]
        require_fits(snapshot, (self.num_envs, sum(widths)))
        for part, saved in zip(parts, snapshot.split(widths, dim=-1), strict=True):
            part.copy_(saved)
        self._current = False

    def _parts(self) -> list[Tensor]:
        """All that the future depends on, each [N, ...]."""
        state = (self._qpos, self._qvel, self._act, self._ctrl, self._warmstart)
        return [*state, self._time[:, None]]


_LOST = int(
    mjw.OverflowType.NEFC
    | mjw.OverflowType.NJMAX_NNZ
    | mjw.OverflowType.BROADPHASE
    | mjw.OverflowType.NARROWPHASE
    | mjw.OverflowType.CCD
    | mjw.OverflowType.HFIELD
)
"""What overflows where contacts or their constraints found no room."""


def _columns(columns: Columns, device: torch.device) -> slice | Tensor:
    if isinstance(columns, slice):
        return columns
    return torch.from_numpy(columns).long().to(device)
