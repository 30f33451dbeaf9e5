"""`VecEnv` of robots that walk two and two, side by side.

Robots 2i and 2i + 1 are a team: one world, one command, one end. PPO sees N robots like
any others, so that one policy walks both and each is paid for itself; a reward sees the
other one in the columns behind those of the feature row.

Shapes: N robots, K robots that begin, F columns of the feature row, V of the sight.
"""

from __future__ import annotations

import torch
from tensordict import TensorDict
from torch import Tensor

from data.episodes.team_rows import sight_column, team_sight
from data.errors import GaitprefError
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import EnvCfg, RandomiseCfg
from policy.env.feature_row import BaseState
from policy.robots.robot import Robot
from policy.sim.sim import SimState
from policy.training.ppo import RewardPpo, Runner
from policy.training.train_cfg import TrainCfg

from .pair_sim import PairSim


class TeamEnv(QuadrupedEnv):
    """N robots in N / 2 teams; observations [N, 48 + V], and one number more where they
    are told apart; feature rows [N, F + V]."""

    OF_TEAMS = True
    sim: PairSim

    def __init__(
        self,
        robot: Robot,
        cfg: EnvCfg,
        num_envs: int,
        *,
        seed: int,
        keep_final: bool = False,
    ) -> None:
        """See `QuadrupedEnv`.

        Raises:
            GaitprefError: the number is odd, the robot cannot be there twice, or `cfg`
                asks for something that no team does.
        """
        _require_plain(cfg)
        super().__init__(
            robot,
            cfg,
            num_envs,
            seed=seed,
            sim=PairSim(robot, num_envs),
            keep_final=keep_final,
        )

    @property
    def episode_length_buf(self) -> Tensor:
        """[N] control steps since the reset, equal in a team."""
        return self._episode_length

    @episode_length_buf.setter
    def episode_length_buf(self, steps: Tensor) -> None:
        # Who spreads time-outs over all robots must not part a team.
        self._episode_length = steps[::2].repeat_interleave(2)

    def score(self, features: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        """Task reward [...] of rows [..., F + V], the formation by hand included, and
        the mean of every term."""
        rewards, log = super().score(features)
        terms = self._formation(features)
        for name, term in terms.items():
            rewards = rewards + term * self.step_dt
            log[f"task/{name}"] = term.mean()
        return rewards, log

    def _formation(self, features: Tensor) -> dict[str, Tensor]:
        """What keeping the formation earns, each [...], per second."""
        cfg = self.cfg.team
        assert cfg is not None
        ahead, left = features[..., sight_column("mate_pos_h")].unbind(-1)
        off = ahead.square() + (left.abs() - cfg.gap_m).square()
        cosine = features[..., sight_column("mate_turned")][..., 0]
        return {
            "formation": cfg.formation * torch.exp(-off / 0.1),
            "heading": cfg.heading * cosine,
        }

    def _features(
        self, base: BaseState, state: SimState, previous: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        features, fallen, finite = super()._features(base, state, previous)
        # One that falls ends it for both; the rows still say which one it was.
        return (
            torch.cat([features, seen_of_mate(state)], dim=-1),
            fallen.view(-1, 2).any(dim=1).repeat_interleave(2),
            finite.view(-1, 2).all(dim=1).repeat_interleave(2),
        )

    def _observe(self, state: SimState, base: BaseState | None = None) -> Tensor:
        parts = [super()._observe(state, base), seen_of_mate(state)]
        assert self.cfg.team is not None
        if self.cfg.team.told_apart:
            parts.append((torch.arange(len(parts[0])) % 2)[:, None].float())
        return torch.cat(parts, dim=-1)

    def _draw_commands(self, count: int) -> Tensor:
        """Commands [K, 3]; a team is told the same."""
        return super()._draw_commands(count)[::2].repeat_interleave(2, dim=0)

    def _start_states(self, count: int) -> tuple[Tensor, Tensor]:
        """States [K, nq] and [K, nv] of teams that begin side by side, give or take."""
        qpos, qvel = super()._start_states(count)
        cfg = self.cfg.team
        assert cfg is not None
        qpos[:, 0:1] += self._noise(count, 1, cfg.start_along_m)
        qpos[:, 1:2] += self._noise(count, 1, cfg.start_across_m)
        qpos[0::2, 1] += cfg.gap_m / 2
        qpos[1::2, 1] -= cfg.gap_m / 2
        half = self._noise(count, 1, cfg.start_rad)[:, 0].double() / 2
        c, s = half.cos(), half.sin()
        w, x, y, z = qpos[:, 3:7].clone().unbind(-1)
        turned = (c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w)
        qpos[:, 3:7] = torch.stack(turned, dim=-1)
        return qpos, qvel


def seen_of_mate(state: SimState) -> Tensor:
    """What each of N robots sees of the other of its team, [N, V]."""
    qpos = torch.cat([state.base_pos_w, state.base_wxyz_w], dim=-1).view(-1, 2, 7)
    seen = team_sight(qpos.numpy(), state.base_lin_vel_w.view(-1, 2, 3).numpy())
    return torch.from_numpy(seen).flatten(0, 1)


def team_runner(robot: Robot, cfg: TrainCfg, seed: int) -> Runner:
    """An engine of `train` whose robots walk in teams."""
    if cfg.sim is not None:
        raise GaitprefError("teams walk on the processor alone: leave --device out")
    env = TeamEnv(robot, cfg.env, cfg.ppo.num_envs, seed=seed)
    algorithm = RewardPpo if cfg.ppo.policies is None else TwoPpo
    return Runner(env, cfg.ppo, algorithm=algorithm)


class TwoPpo(RewardPpo):
    """PPO of two policies, each of which learns from its own robot's share alone."""

    def compute_returns(self, obs: TensorDict) -> None:
        """As the parent; advantages are measured against those of the same robot."""
        super().compute_returns(obs)
        advantages = self.storage.returns - self.storage.values
        for robot in (0, 1):
            own = advantages[:, robot::2]
            advantages[:, robot::2] = (own - own.mean()) / (own.std() + 1e-8)
        self.storage.advantages = advantages


def _require_plain(cfg: EnvCfg) -> None:
    """
    Raises:
        GaitprefError: something is asked for that no team does.
    """
    asked = {
        "other ground than a plane": cfg.terrain.kind != "flat",
        "getting up": cfg.getup is not None,
        "commands that widen": cfg.curriculum is not None,
        "robots that differ": cfg.randomise != RandomiseCfg(),
        "a policy from elsewhere, or one without the velocity of the base": (
            cfg.law is not None
        ),
    }
    if wrong := [name for name, is_asked in asked.items() if is_asked]:
        raise GaitprefError(f"a team knows nothing of {', '.join(wrong)}: leave it out")
