"""The environment PPO sees: RSL-RL's `VecEnv` over a batch of quadrupeds.

Shapes: N environments, F feature columns, K environments being reset.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any, ClassVar

import torch
from rsl_rl.env import VecEnv
from tensordict import TensorDict
from torch import Tensor

from data.errors import GaitprefError
from data.features import column
from policy.law.encoder import Encoder
from policy.parallel.ranks import ALONE, Ranks
from policy.robots.robot import Robot
from policy.sim.batch_sim import BatchSim
from policy.sim.chosen import Rows
from policy.sim.field import Field
from policy.sim.sim import Sim, SimState

from .course import Lane
from .curriculum import Curriculum
from .draws import around_zero, uniforms
from .env_cfg import EnvCfg, Range
from .feature_row import OBS_DIM, BaseState, base_state, feature_row, observation
from .getup import Lying
from .joint_targets import JointTargets
from .seeding import spawned
from .start_states import StartStates
from .task_reward import task_reward_for, weighted
from .terrain import Starts, near_edge
from .world import in_world

ONE_OR_TWO = (
    "this policy walks in a team of two and is blind without the other robot: "
    "`gaitpref team record --policy POLICY --dataset DIR` shows what it does, and "
    "`gaitpref film --dataset DIR --clip CLIP` films it",
    "this policy walks alone: `gaitpref team train --init POLICY --out DIR` makes a "
    "team of two out of it",
)
"""What is wrong where a policy of two is taken for one that is alone, and the other way
round."""


class QuadrupedEnv(VecEnv):
    """N quadrupeds following velocity commands.

    `step` resets finished environments before it returns, as RSL-RL expects; what the
    step led to is in `extras["features"]`, computed before any reset.
    """

    OF_TEAMS: ClassVar = False
    """Whether two and two robots are in one world."""

    def __init__(
        self,
        robot: Robot,
        cfg: EnvCfg,
        num_envs: int,
        *,
        seed: int,
        sim: Sim | None = None,
        keep_final: bool = False,
        ranks: Ranks = ALONE,
    ) -> None:
        """Make and reset `num_envs` environments.

        Args:
            robot: The robot.
            cfg: The environment.
            num_envs: How many run side by side.
            seed: Where all chance comes from.
            sim: A simulator of `num_envs` copies; MuJoCo on the CPU by default.
            keep_final: Put the states before any reset into `extras["final"]`.
            ranks: Who has further environments of the same training.
        """
        if (cfg.team is not None) != self.OF_TEAMS:
            raise GaitprefError(ONE_OR_TWO[self.OF_TEAMS])
        self.robot = robot = in_world(robot, cfg)
        self.cfg: EnvCfg = cfg  # pyright: ignore[reportIncompatibleVariableOverride]
        self.task = task_reward_for(robot, cfg.task)
        self.sim = sim or BatchSim(robot, num_envs)
        self.num_envs = num_envs
        self.num_actions = 12
        self.max_episode_length = cfg.episode_steps
        self.device = self.sim.device
        env_seed, dropped_seed = spawned(seed, 2)
        self._rng = torch.Generator(device=self.device).manual_seed(env_seed)
        self._joint_targets = JointTargets(robot, cfg, self.device)
        self._encoder = None
        if cfg.law is not None:
            self._encoder = Encoder(cfg.law, num_envs, device=self.device)
        self._home_joint_pos = self._constant(robot.home_joint_pos)
        self._foot_radius = self._constant(robot.foot_radius)
        ground = robot.ground
        self._field = None if ground is None else Field(ground, self.device)
        self._lane = None if cfg.course is None else Lane(cfg.course, self.device)
        self._lying = None
        if cfg.getup is not None:
            self._lying = Lying(robot, cfg.getup, seed=dropped_seed, device=self.device)
        places = None
        if self._field is not None:
            places = self._lane or Starts(robot, self._field)
        self._starts = StartStates(
            robot, cfg.reset, self.device, places=places, lying=self._lying
        )
        self._curriculum = None
        if cfg.curriculum is not None:
            self._curriculum = Curriculum(
                cfg.curriculum,
                control_dt_s=cfg.control_dt_s,
                device=self.device,
                ranks=ranks,
            )
        self._fall_height = cfg.fall.height_ratio * float(robot.home_qpos[2])
        self._fall_cosine = float(torch.cos(torch.tensor(cfg.fall.tilt_rad)))
        zeros = torch.zeros(num_envs, 12, device=self.device)
        self.episode_length_buf = torch.zeros(
            num_envs, dtype=torch.long, device=self.device
        )
        self.command = zeros[:, :3].clone()
        self.action = zeros
        self._air_time = zeros[:, :4].clone()
        self._starting = torch.ones(num_envs, dtype=torch.bool, device=self.device)
        self._no_reward = torch.zeros(num_envs, device=self.device)
        self._commands_fixed = False
        self._keep_final = keep_final
        self._true_obs = torch.zeros(num_envs, OBS_DIM, device=self.device)
        self._reset_all()
        self._obs = self._observe(self.sim.read())

    @property
    def unwrapped(self) -> QuadrupedEnv:
        """Itself; RSL-RL's extensions look here for `step_dt`."""
        return self

    @property
    def step_dt(self) -> float:
        """Time between two actions, s."""
        return self.cfg.control_dt_s

    def get_observations(self) -> TensorDict:
        """The current observations, `{"policy": [N, 48]}`.

        On a course, what is ahead follows them.

        Under a law, `policy` is what the law says and `privileged` [N, 48] is what
        policies of this project see.
        """
        groups = {"policy": self._obs}
        if self._encoder is not None:
            groups["privileged"] = self._true_obs
        return TensorDict(groups, batch_size=[self.num_envs])

    @property
    def own_obs(self) -> Tensor:
        """[N, 48] what policies of this project see, without noise, whatever the law.

        It is what is recorded, so that episodes of all policies are alike."""
        return self._true_obs

    def fix_commands(self, command: Tensor) -> None:
        """Ask for `command` [N, 3] from now on, in this and all later episodes."""
        self.command = command.to(self.device, torch.float32).clone()
        self._commands_fixed = True
        self._obs = self._observe(self.sim.read())

    def reset(self, *, seed: int) -> TensorDict:
        """Start new episodes everywhere, the same for the same `seed`."""
        self._rng.manual_seed(spawned(seed, 2)[0])
        self._reset_all()
        self._starting = torch.ones_like(self._starting)
        self._obs = self._observe(self.sim.read())
        return self.get_observations()

    def step(
        self, actions: Tensor, *, score: bool = True
    ) -> tuple[TensorDict, Tensor, Tensor, dict[str, Any]]:
        """Apply `actions` [N, 12] for one control step.

        Returns observations after any reset, the task reward [N], `dones` [N] and
        extras: `features` [N, F] and `starts` [N] of this step, `time_outs`, `aborted`
        (the simulation diverged; its row is all zeros) and `log`. Without `score` the
        reward is 0 and the log empty: for who scores whole rollouts.
        """
        previous, starts = self.action, self._starting
        self.action = actions.clamp(-self.cfg.action_limit, self.cfg.action_limit)
        targets = self.targets(self.action)
        if self._encoder is not None:
            self._encoder.advance()
        self.sim.set_targets(targets)
        aborted = self.sim.advance(self.cfg.substeps)
        self.episode_length_buf += 1

        state = self.sim.read()
        base = base_state(state)
        features, fallen, finite = self._features(base, state, previous)
        aborted |= ~finite
        # A diverged simulation was reset behind our back: nothing is usable.
        features.masked_fill_(aborted[:, None], 0.0)
        fallen &= ~aborted
        ends = self.episode_length_buf >= self.max_episode_length
        if self._field is not None:
            ends |= near_edge(self._field, state.base_pos_w)
        time_outs = ends & ~fallen
        dones = fallen | time_outs | aborted
        rewards, log = self.score(features) if score else (self._no_reward, {})
        if self._curriculum is not None:
            self._curriculum.observe(features)
            log["command/share"] = self._curriculum.share
        extras = {
            "features": features,
            "starts": starts,
            "targets": targets,
            # Aborted episodes are bootstrapped too: the policy is not to blame.
            "time_outs": time_outs | aborted,
            "aborted": aborted,
            "fallen": fallen,
            "log": log,
        }
        if self._lane is not None:
            extras["ahead"] = self._ahead(self._lane, state)
        if self._keep_final:
            extras["final"] = (*self.sim.raw_state(), self._own_obs(state, base))
        self._resample_commands()
        rows = self.sim.rows(dones)
        if rows is not None:
            self._reset(rows)
            fresh = self.sim.read(rows)
            if rows.count == self.num_envs:
                state, base = fresh, base_state(fresh)
            else:
                _overwrite(state, rows, fresh)
                _overwrite(base, rows, base_state(fresh))
        self._starting = dones
        self._obs = self._observe(state, base)
        return self.get_observations(), rewards, dones, extras

    @property
    def action_scale_rad(self) -> float | Tensor:
        """Joint offset that an action of 1 asks for; [12] where joints differ."""
        return self._joint_targets.scale_rad

    def targets(self, action: Tensor) -> Tensor:
        """Joint positions [N, 12] that `action` [N, 12] asks for, rad."""
        return self._joint_targets.of(action)

    def reach(self) -> Tensor:
        """[12] the action that asks for the farther end of each joint's range; infinite
        where there is none."""
        return self._joint_targets.reach()

    def snapshot(self) -> dict[str, Tensor]:
        """All state as plain tensors, so that a killed run goes on bit for bit."""
        state = {
            "sim": self.sim.snapshot(),
            "episode_length": self.episode_length_buf.clone(),
            "command": self.command.clone(),
            "action": self.action.clone(),
            "air_time": self._air_time.clone(),
            "starting": self._starting.clone(),
            "rng": self._rng.get_state(),
        }
        if self._curriculum is not None:
            state["curriculum"] = self._curriculum.snapshot()
        if self._encoder is not None:
            state |= self._encoder.snapshot()
        return state

    def restore(self, snapshot: dict[str, Tensor]) -> None:
        """Go on from `snapshot` of an environment of equal configuration."""
        self.sim.restore(snapshot["sim"])
        self.episode_length_buf = self._own(snapshot["episode_length"])
        self.command = self._own(snapshot["command"])
        self.action = self._own(snapshot["action"])
        self._air_time = self._own(snapshot["air_time"])
        self._starting = self._own(snapshot["starting"])
        self._rng.set_state(snapshot["rng"])
        if self._curriculum is not None:
            self._curriculum.restore(snapshot["curriculum"])
        if self._encoder is not None:
            self._encoder.restore(snapshot)
        self._obs = self._observe(self.sim.read())

    def _features(
        self, base: BaseState, state: SimState, previous: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Feature rows [N, F], fallen [N] and finite [N] of the state reached."""
        in_air = 1.0 - state.foot_contact
        self._air_time = (self._air_time + self.step_dt) * in_air
        fallen = (
            (base.gravity_b[:, 2] > -self._fall_cosine)
            | (state.base_height < self._fall_height)
            | (state.base_contact > 0)
        )
        if self._lying is not None:
            fallen = torch.zeros_like(fallen)
        features = feature_row(
            base,
            state,
            home_joint_pos=self._home_joint_pos,
            foot_radius=self._foot_radius,
            command=self.command,
            action=self.action,
            previous_action=previous,
            foot_air_time=self._air_time,
            fallen=fallen,
        )
        # One number that is not finite makes the sum of its row so.
        return features, fallen, features.sum(dim=-1).isfinite()

    def score(self, features: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        """Task reward [...] of feature rows [..., F], and the mean of every term."""
        terms = weighted(features, self.task, control_dt_s=self.step_dt) * self.step_dt
        means = terms.flatten(1).mean(dim=1) / self.step_dt
        log = {f"task/{k}": v for k, v in zip(self.task.weights, means, strict=True)}
        asked, moved = column("command"), column("base_lin_vel_b")
        missed = features[..., asked][..., :2] - features[..., moved][..., :2]
        error = torch.linalg.vector_norm(missed, dim=-1).mean()
        return terms.sum(dim=0), {**log, "track/planar_error_m_s": error}

    def _observe(self, state: SimState, base: BaseState | None = None) -> Tensor:
        """What the policy sees; `base` where it is known already."""
        self._true_obs = self._own_obs(state, base)
        seen = self._encoded(self._true_obs)
        if self._lane is None:
            return seen
        return torch.cat((seen, self._ahead(self._lane, state)), dim=1)

    def _ahead(self, lane: Lane, state: SimState) -> Tensor:
        """What is ahead on the course, [N, 6]."""
        time_s = self.episode_length_buf * self.step_dt
        return lane.ahead(state.base_pos_w[:, 0], time_s)

    def _own_obs(self, state: SimState, base: BaseState | None) -> Tensor:
        """Observations [N, 48] as policies of this project see them."""
        return observation(
            base or base_state(state),
            state,
            home_joint_pos=self._home_joint_pos,
            action=self.action,
            command=self.command,
        )

    def _encoded(self, own: Tensor) -> Tensor:
        """What the policy sees of its own observation [N, 48], true or with noise."""
        if self._encoder is None:
            return own
        return self._encoder.observe(own, begins=self.episode_length_buf == 0)

    def _resample_commands(self) -> None:
        if self._commands_fixed or self.cfg.commands.resample_s == float("inf"):
            return
        period = max(1, round(self.cfg.commands.resample_s / self.step_dt))
        due = self.sim.rows(self.episode_length_buf % period == 0)
        if due is not None:
            due.put(self.command, self._draw_commands(due.count))

    def _draw_commands(self, count: int) -> Tensor:
        cfg = self.cfg.commands
        ranges = (cfg.forward_m_s, cfg.left_m_s, cfg.yaw_rad_s)
        if self._curriculum is not None:
            ranges = tuple(map(self._curriculum.range, ranges))
        return torch.cat(uniforms(self._rng, count, *((1, r) for r in ranges)), dim=-1)

    def _reset_all(self) -> None:
        """Start new episodes everywhere."""
        self._reset(self._everyone())

    def _everyone(self) -> Rows:
        rows = self.sim.rows(torch.ones_like(self._starting))
        assert rows is not None
        return rows

    def _reset(self, rows: Rows) -> None:
        """Start new episodes in the environments `rows`."""
        self.sim.reset(rows, *self._start_states(rows.count))
        rows.put(self.episode_length_buf, 0)
        self.action = self.action.clone()
        rows.put(self.action, 0.0)
        rows.put(self._air_time, 0.0)
        if not self._commands_fixed:
            rows.put(self.command, self._draw_commands(rows.count))

    def _start_states(self, count: int) -> tuple[Tensor, Tensor]:
        """States [K, nq] and [K, nv] that episodes begin in."""
        return self._starts.draw(count, self._rng)

    def _noise(self, rows: int, width: int, amplitude: float) -> Tensor:
        return self._uniform(rows, width, around_zero(amplitude))

    def _uniform(self, rows: int, width: int, interval: Range) -> Tensor:
        return uniforms(self._rng, rows, (width, interval))[0]

    def _own(self, values: Tensor) -> Tensor:
        """A copy of `values` where the environment is."""
        return values.to(self.device, copy=True)

    def _constant(self, values: Any) -> Tensor:
        return torch.tensor(values, dtype=torch.float32, device=self.device)


def _overwrite(record: SimState | BaseState, rows: Rows, fresh: Any) -> None:
    """Put the rows [K] of `fresh` into their rows of every tensor."""
    for item in fields(record):
        rows.put(getattr(record, item.name), getattr(fresh, item.name))
