"""Robots that differ: what a policy has to cope with outside the simulator.

Every episode draws its own friction, masses, centre of mass, motor strength, delay and
encoder bias; pushes and noise of the sensors come on top. The hot path of
`QuadrupedEnv` knows nothing of it.

Shapes: N environments, K of them being reset, P columns of the critic's own group.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor

from data.features import LEGS
from policy.parallel.ranks import ALONE, Ranks
from policy.robots.anatomy import bodies_below
from policy.robots.robot import Robot

from .env import QuadrupedEnv
from .env_cfg import EnvCfg, NoiseCfg, RandomiseCfg
from .feature_row import OBS_DIM, BaseState, obs_column
from .sim import BatchSim, SimState
from .world import in_world

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
PRIVILEGED_DIM = OBS_DIM + 1 + 2 * len(LEGS) + DRAWN_DIM
"""Columns of the critic's own group."""


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


class VariedSim(BatchSim):
    """MuJoCo on the CPU, with fields of the model that differ between simulations."""

    def __init__(self, robot: Robot, num_envs: int, *, threads: int = 0) -> None:
        """See `BatchSim`."""
        super().__init__(robot, num_envs, threads=threads)
        mj_model, batch = self._mj_model, self._batch
        self._bodies = bodies_below(mj_model, robot.base_body_id)
        names = ("geom_friction", "body_mass", "body_inertia", "body_ipos")
        names += ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange")
        names += ("pair_friction",) if mj_model.npair else ()
        self._nominal = {name: getattr(mj_model, name).copy() for name in names}
        self._fields = {name: batch.expand(name) for name in names}
        nobody = {name: torch.zeros(num_envs, width) for name, width in DRAWN.items()}
        for factor in ("friction", "mass", "strength"):
            nobody[factor] += 1.0
        self.draw = Draw(**nobody)
        home = torch.tensor(robot.home_joint_pos, dtype=torch.float32)
        self.late_targets = home.repeat(num_envs, 1)

    def vary(self, ids: Tensor, draw: Draw) -> None:
        """Make the robots `ids` [K] as `draw` says, from their next reset on."""
        columns = self.draw.columns
        columns[ids] = draw.columns
        self.draw = Draw.of_columns(columns)
        rows, nominal, fields = ids.numpy(), self._nominal, self._fields

        def scaled(name: str, by: Tensor, columns: Any = slice(None)) -> None:
            value = nominal[name][..., columns]
            shape = (len(rows), *([1] * value.ndim))
            fields[name][rows, ..., columns] = (
                by.double().numpy().reshape(shape) * value
            )

        scaled("geom_friction", draw.friction, slice(0, 1))
        if "pair_friction" in fields:
            scaled("pair_friction", draw.friction, slice(0, 2))
        scaled("body_mass", draw.mass)
        scaled("body_inertia", draw.mass)
        base = self.robot.base_body_id
        fields["body_ipos"][rows, base] = (
            nominal["body_ipos"][base] + draw.com_m.numpy()
        )
        for name in ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange"):
            scaled(name, draw.strength)
        self._batch.set_const(rows)

    def set_targets(self, joint_pos: Tensor) -> None:
        """See `Sim.set_targets`; encoders lie to servos as they do to the policy."""
        late = self.draw.delayed > 0
        arriving = torch.where(late, self.late_targets, joint_pos)
        self.late_targets = joint_pos.clone()
        super().set_targets(arriving - self.draw.encoder_bias_rad)

    def reset(self, ids: Tensor, qpos: Tensor, qvel: Tensor) -> None:
        """See `Sim.reset`."""
        super().reset(ids, qpos, qvel)
        home = torch.tensor(self.robot.home_joint_pos, dtype=torch.float32)
        self.late_targets[ids] = home

    def push(self, ids: Tensor, velocity_m_s: Tensor) -> None:
        """Change the horizontal velocities of the bases `ids` [K] by [K, 2]."""
        first = self._base_adr[1]
        self._qvel[ids.numpy(), first : first + 2] += velocity_m_s.numpy()


class RandomisedEnv(QuadrupedEnv):
    """`QuadrupedEnv` with robots that differ, noise, pushes, and a critic's own view.

    Observations have a second group `privileged` [N, 76] for the critic: the true
    observation, height, contacts and heights of the feet, and how this robot differs.
    """

    sim: VariedSim

    def __init__(
        self,
        robot: Robot,
        cfg: EnvCfg,
        num_envs: int,
        *,
        seed: int,
        keep_final: bool = False,
        threads: int = 0,
        ranks: Ranks = ALONE,
    ) -> None:
        """See `QuadrupedEnv`."""
        self._cfg = cfg.randomise
        self._amplitudes = _amplitudes(self._cfg.noise)
        self._foot_radii = torch.tensor(robot.foot_radius, dtype=torch.float32)
        self._privileged = torch.zeros(num_envs, PRIVILEGED_DIM)
        robot = in_world(robot, cfg)
        super().__init__(
            robot,
            cfg,
            num_envs,
            seed=seed,
            sim=VariedSim(robot, num_envs, threads=threads),
            keep_final=keep_final,
            ranks=ranks,
        )

    def get_observations(self) -> TensorDict:
        """The current observations: `policy` [N, 48], or what its law says, and
        `privileged` [N, 76]."""
        groups = {"policy": self._obs, "privileged": self._privileged}
        return TensorDict(groups, batch_size=[self.num_envs])

    def step(
        self, actions: Tensor, *, score: bool = True
    ) -> tuple[TensorDict, Tensor, Tensor, dict[str, Any]]:
        """See `QuadrupedEnv.step`."""
        cfg = self._cfg
        if cfg.push_m_s > 0:
            period = max(1, round(cfg.push_every_s / self.step_dt))
            due = self.episode_length_buf % period == period - 1
            ids = due.nonzero().flatten()
            if len(ids):
                self.sim.push(ids, self._noise(len(ids), 2, cfg.push_m_s))
        return super().step(actions, score=score)

    def snapshot(self) -> dict[str, Tensor]:
        """See `QuadrupedEnv.snapshot`."""
        return super().snapshot() | {
            "draw": self.sim.draw.columns,
            "late_targets": self.sim.late_targets.clone(),
            "obs": self._obs.clone(),
            "privileged": self._privileged.clone(),
        }

    def restore(self, snapshot: dict[str, Tensor]) -> None:
        """See `QuadrupedEnv.restore`."""
        everyone = torch.arange(self.num_envs)
        self.sim.vary(everyone, Draw.of_columns(snapshot["draw"].clone()))
        super().restore(snapshot)
        self.sim.late_targets = snapshot["late_targets"].clone()
        # Observing draws noise: what was seen is taken over, and so is the generator.
        self._obs = snapshot["obs"].clone()
        self._privileged = snapshot["privileged"].clone()
        self._rng.set_state(snapshot["rng"])

    def _reset(self, ids: Tensor) -> None:
        self.sim.vary(ids, self._draw(len(ids)))
        super()._reset(ids)

    def _draw(self, count: int) -> Draw:
        cfg = self._cfg
        return Draw(
            friction=self._uniform(count, 1, cfg.friction),
            mass=self._uniform(count, 1, cfg.mass),
            com_m=self._noise(count, 3, cfg.com_m),
            strength=self._uniform(count, 1, cfg.strength),
            delayed=(self._uniform(count, 1, (0.0, 1.0)) < cfg.delayed_share).float(),
            encoder_bias_rad=self._noise(count, 12, cfg.encoder_bias_rad),
        )

    def _observe(self, state: SimState, base: BaseState | None = None) -> Tensor:
        self._true_obs = true = self._own_obs(state, base)
        draw = self.sim.draw
        self._privileged = torch.cat(
            (
                true,
                state.base_height[:, None],
                state.foot_contact,
                state.foot_height - self._foot_radii,
                draw.columns,
            ),
            dim=-1,
        )
        seen = true.clone()
        seen[:, obs_column("joint_pos_offset")] += draw.encoder_bias_rad
        noise = self._uniform(self.num_envs, true.shape[1], (-1.0, 1.0))
        return self._encoded(seen + noise * self._amplitudes)


def make_env(
    robot: Robot,
    cfg: EnvCfg,
    num_envs: int,
    *,
    seed: int,
    keep_final: bool = False,
    threads: int = 0,
    ranks: Ranks = ALONE,
) -> QuadrupedEnv:
    """The environment `cfg` asks for: robots all alike, or robots that differ."""
    kind = QuadrupedEnv if cfg.randomise == RandomiseCfg() else RandomisedEnv
    return kind(
        robot,
        cfg,
        num_envs,
        seed=seed,
        keep_final=keep_final,
        threads=threads,
        ranks=ranks,
    )


def _amplitudes(cfg: NoiseCfg) -> Tensor:
    """Noise [48] of every column of an observation; actions and commands are known."""
    sizes = {
        "base_lin_vel_b": cfg.lin_vel_m_s,
        "base_ang_vel_b": cfg.ang_vel_rad_s,
        "gravity_b": cfg.gravity,
        "joint_pos_offset": cfg.joint_pos_rad,
        "joint_vel": cfg.joint_vel_rad_s,
    }
    amplitudes = torch.zeros(OBS_DIM)
    for name, size in sizes.items():
        amplitudes[obs_column(name)] = size
    return amplitudes
