"""Recording teams: episodes that hold both robots, some with one that is lazy.

A team in which both always do their part says nothing of what one is worth to it. So in
some episodes one robot holds still for half of the time, on purpose.

Shapes: N robots, T steps of an episode.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from data.episodes.episode_records import ROBOTS, Episode
from data.errors import GaitprefError
from data.features import FEATURE_DIM
from data.files.telling import Tell, silent
from policy.env.env import ONE_OR_TWO
from policy.env.seeding import spawned
from policy.rollouts.record_cfg import recorded_commands
from policy.rollouts.rolled_out import episode_of, logged, meta_of
from policy.rollouts.rollout import Actor, RolloutStep, first_episodes
from policy.training.checkpoint import Policy

from .team_env import TeamEnv

LAZY = "lazy_robot"
"""Name in `EpisodeMeta.extra` of the robot, 1 or 2, that holds still now and then."""


@dataclass(frozen=True, kw_only=True)
class TeamRecordCfg:
    """What is recorded of a team."""

    episodes: int = 40
    """Episodes in all, each of two robots."""
    episode_s: float = 6.0
    """Length of one that does not fall."""
    noisy_share: float = 0.5
    """Share with exploration noise, so that clips differ."""
    lazy_share: float = 0.0
    """Share in which one robot is lazy, in turn the first and the second."""
    lazy_robot: int | None = None
    """The robot that is, always; None takes turns."""
    lazy_s: float = 1.0
    """For so long it holds still, then walks as long, and so on: half of the time."""
    start_along_m: float = 0.6
    """Noise of where each begins along the way. Teams that all begin in formation and
    drift apart are in it while they set off, and setting off looks like the reason."""
    start_rad: float = 0.5
    """Noise of the heading that each begins with, for the same reason."""

    def __post_init__(self) -> None:
        if self.episodes < 1 or not self.episode_s > 0 or not self.lazy_s > 0:
            raise ValueError(
                "episodes, episode_s and lazy_s must be above 0, got "
                f"{self.episodes}, {self.episode_s} and {self.lazy_s}"
            )
        if not (0 <= self.noisy_share <= 1 and 0 <= self.lazy_share <= 1):
            raise ValueError(
                "shares must lie in [0, 1], got "
                f"{self.noisy_share} and {self.lazy_share}"
            )
        if self.lazy_robot not in (None, 1, 2):
            raise ValueError(f"the robots are 1 and 2, not {self.lazy_robot}")


class Lazy:
    """An actor of which some robots hold the home pose for half of the time."""

    def __init__(self, actor: Actor, lazy: Tensor, *, steps: int) -> None:
        """`lazy` [N] bool; every `steps` control steps they stop or go on."""
        self._actor, self._lazy, self._steps = actor, lazy, steps
        self._step = 0

    def __call__(self, obs: Tensor, noise: Tensor | None = None) -> Tensor:
        """Actions [N, 12]."""
        still = self._lazy & (self._step // self._steps % 2 == 1)
        self._step += 1
        return self._actor(obs, noise).masked_fill(still[:, None], 0.0)


def record_team(
    policy: Policy,
    cfg: TeamRecordCfg,
    *,
    seed: int,
    round: int = 0,
    tell: Tell = silent,
) -> Iterator[Episode]:
    """Episodes of teams, one after the other.

    Args:
        policy: Walks both robots of each.
        cfg: How many, how long, how many of them lazy.
        seed: Start states and exploration noise.
        round: Stored with every episode.
        tell: Gets the control steps that all of them have walked, of as many as the
            longest may have.

    Raises:
        GaitprefError: the policy walks alone.
    """
    info, count = policy.info, cfg.episodes
    if info.env.team is None:
        raise GaitprefError(ONE_OR_TWO[1])
    team_cfg = replace(
        info.env.team, start_along_m=cfg.start_along_m, start_rad=cfg.start_rad
    )
    env_cfg = replace(info.env, episode_s=cfg.episode_s, team=team_cfg)
    env_seed, actor_seed = spawned(seed, 2)
    env = TeamEnv(policy.robot(), env_cfg, 2 * count, seed=env_seed, keep_final=True)
    choices = recorded_commands(env_cfg.commands)
    told = [choices[team % len(choices)] for team in range(count)]
    env.fix_commands(torch.tensor(told).repeat_interleave(2, dim=0))
    noisy = _turns(count, cfg.noisy_share)
    who = _lazy_robots(noisy, cfg)
    lazy = torch.from_numpy(np.stack([who == 1, who == 2], axis=1)).flatten()
    still = max(1, int(cfg.lazy_s / env_cfg.control_dt_s + 0.5))
    steps: list[RolloutStep] = []
    for step in first_episodes(
        Lazy(policy, lazy, steps=still),
        env,
        noise=torch.from_numpy(noisy).float().repeat_interleave(2),
        rng=torch.Generator().manual_seed(actor_seed),
    ):
        steps.append(step)
        tell(len(steps), env_cfg.episode_steps)
    arrays, lengths = logged(steps)
    arrays["features"] = arrays["features"][..., :FEATURE_DIM]
    for team in range(count):
        both: list[Episode] = []
        for robot in (2 * team, 2 * team + 1):
            meta = meta_of(
                policy,
                env,
                command=told[team],
                seed=seed,
                index=robot,
                stochastic=bool(noisy[team]),
                round=round,
            )
            meta.extra[ROBOTS] = "2"
            if who[team]:
                meta.extra[LAZY] = str(who[team])
            num_steps = int(lengths[robot])
            rows = {name: array[robot, :num_steps] for name, array in arrays.items()}
            both.append(
                episode_of(steps[num_steps - 1], rows, robot, meta, env.sim.mjcf)
            )
        yield replace(both[0], mate=both[1])


def _lazy_robots(noisy: np.ndarray, cfg: TeamRecordCfg) -> np.ndarray:
    """Which robot of each team [N] is lazy, 0 where none is.

    As many with noise [N] as without: else what is lazy and what is shaky, or which of
    the two it is, would be one.
    """
    who = np.zeros(len(noisy), dtype=int)
    for group in (noisy, ~noisy):
        lazy = np.flatnonzero(group)[_turns(int(group.sum()), cfg.lazy_share)]
        who[lazy] = cfg.lazy_robot or 1 + np.arange(len(lazy)) % 2
    return who


def _turns(count: int, share: float) -> np.ndarray:
    """A share of `count` episodes [N] bool, evenly spread."""
    turn = np.arange(count)
    return np.floor((turn + 1) * share) > np.floor(turn * share)
