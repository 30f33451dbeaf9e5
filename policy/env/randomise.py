"""Robots that differ: what a policy has to cope with outside the simulator.

Every episode draws its own friction, masses, centre of mass, motor strength, delay and
encoder bias; pushes and noise of the sensors come on top. The hot path of
`QuadrupedEnv` knows nothing of it.

Shapes: N environments, K of them being reset, P columns of the critic's own group.
"""

from __future__ import annotations

from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor

from data.features import LEGS
from policy.parallel.ranks import ALONE, Ranks
from policy.robots.robot import Robot
from policy.sim.chosen import Rows
from policy.sim.draw import DRAWN_DIM, Draw
from policy.sim.making import SimCfg, make_sim, make_varied_sim
from policy.sim.sim import SimState, VariedSim

from .env import QuadrupedEnv
from .env_cfg import EnvCfg, NoiseCfg, RandomiseCfg
from .feature_row import OBS_DIM, BaseState, obs_column
from .world import in_world

PRIVILEGED_DIM = OBS_DIM + 1 + 2 * len(LEGS) + DRAWN_DIM
"""Columns of the critic's own group."""


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
        sim: VariedSim,
        ranks: Ranks = ALONE,
    ) -> None:
        """See `QuadrupedEnv`; `sim` is of the robot in its world."""
        self._cfg = cfg.randomise
        self._amplitudes = _amplitudes(self._cfg.noise).to(sim.device)
        self._privileged = torch.zeros(num_envs, PRIVILEGED_DIM, device=sim.device)
        super().__init__(
            robot,
            cfg,
            num_envs,
            seed=seed,
            sim=sim,
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
            rows = self.sim.rows(due)
            if rows is not None:
                self.sim.push(rows, self._noise(rows.count, 2, cfg.push_m_s))
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
        draw = Draw.of_columns(self._own(snapshot["draw"]))
        self.sim.vary(self._everyone(), draw)
        super().restore(snapshot)
        self.sim.late_targets = self._own(snapshot["late_targets"])
        # Observing draws noise: what was seen is taken over, and so is the generator.
        self._obs = self._own(snapshot["obs"])
        self._privileged = self._own(snapshot["privileged"])
        self._rng.set_state(snapshot["rng"])

    def _reset(self, rows: Rows) -> None:
        self.sim.vary(rows, self._draw(rows.count))
        super()._reset(rows)

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
                state.foot_height - self._foot_radius,
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
    sim: SimCfg | None = None,
    threads: int = 0,
    ranks: Ranks = ALONE,
) -> QuadrupedEnv:
    """The environment `cfg` asks for: robots all alike, or robots that differ.

    Raises:
        SimError: the simulator `sim` asks for cannot be had here.
    """
    robot, where = in_world(robot, cfg), sim or SimCfg()
    if cfg.randomise == RandomiseCfg():
        return QuadrupedEnv(
            robot,
            cfg,
            num_envs,
            seed=seed,
            sim=make_sim(robot, num_envs, where, threads=threads),
            ranks=ranks,
        )
    return RandomisedEnv(
        robot,
        cfg,
        num_envs,
        seed=seed,
        sim=make_varied_sim(robot, num_envs, where, threads=threads),
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
