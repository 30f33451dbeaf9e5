"""How good choices are: a policy that chooses, each of its gaits alone, or a rule.

Shapes: N episodes, T steps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from data.files.telling import Tell, silent
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import EnvCfg
from policy.env.feature_row import OBS_DIM
from policy.options.choice_row import ChoiceReward, choice_rows
from policy.training.checkpoint import load_policy

from .gait_files import Gaits

Chosen = Callable[[Tensor], tuple[Tensor, Tensor]]
"""Actions [N, 12] and the gait [N] that gives them, of observations [N, 54]."""


@dataclass(frozen=True, kw_only=True)
class Measured:
    """One way to choose, from the line on."""

    name: str
    reward: float
    """Mean return of an episode under the reward, changes paid for. Answers tell no
    level of it, so by a fitted one who finishes is paid on until the time is up."""
    finished: int
    falls: int
    episodes: int
    metres: float
    """Mean way along the course."""
    seconds: float
    """Mean length of an episode."""
    changes: float
    """Mean number of changes of an episode."""
    shares: tuple[float, ...]
    """Of all steps, with each gait."""


def alone(gaits: Gaits, index: int) -> Chosen:
    """Always one gait."""
    policy = gaits.policies[index]

    def act(obs: Tensor) -> tuple[Tensor, Tensor]:
        return policy(obs[:, :OBS_DIM]), torch.full((len(obs),), index)

    return act


def chosen_by(file: Path) -> Chosen:
    """A policy file that chooses."""
    policy = load_policy(file)

    def act(obs: Tensor) -> tuple[Tensor, Tensor]:
        action = policy(obs)
        gait = policy.gait
        assert gait is not None
        return action, gait

    return act


@torch.inference_mode()
def measure(
    name: str,
    act: Chosen,
    gaits: Gaits,
    env_cfg: EnvCfg,
    reward: ChoiceReward,
    *,
    episodes: int,
    seed: int,
    tell: Tell = silent,
) -> Measured:
    """Run one episode in each of `episodes` environments.

    `tell` gets the control steps that are done, of as many as there may be.
    """
    env = QuadrupedEnv(gaits.robot, env_cfg, episodes, seed=seed, keep_final=True)
    dt_s, course = env.step_dt, env_cfg.course
    assert course is not None
    alive = torch.ones(episodes, dtype=torch.bool)
    returns, metres, used = torch.zeros(3, episodes)
    changes, fell, finished = torch.zeros(3, episodes)
    shares = torch.zeros(len(gaits.names))
    before: Tensor | None = None
    steps = 0
    while alive.any():
        obs = env.get_observations()["policy"]
        action, gait = act(obs)
        changed = torch.zeros_like(alive) if before is None else gait != before
        x = env.sim.raw_state()[0][:, 0]
        _, _, dones, extras = env.step(action, score=False)
        after = extras["final"][0][:, 0]
        moved = torch.where(extras["aborted"], 0.0, (after - x).float())
        rows = choice_rows(
            extras["features"],
            obs[:, OBS_DIM:],
            gait,
            changed,
            moved,
            options=len(gaits.names),
            control_dt_s=dt_s,
        )
        returns += reward(rows) * dt_s * alive
        metres += moved * alive
        used += dt_s * alive
        changes += (changed & alive).float()
        fell += (extras["fallen"] & alive).float()
        finished += (dones & alive & (after > course.length_m - 0.05)).float()
        shares += torch.bincount(gait[alive], minlength=len(shares))
        before = gait
        alive &= ~dones
        steps += 1
        tell(steps, env_cfg.episode_steps)
    if reward.shift:
        left_s = (env_cfg.episode_s - used).clamp_min(0.0)
        returns += finished * returns / used * left_s
    return Measured(
        name=name,
        reward=float(returns.mean()),
        finished=int(finished.sum()),
        falls=int(fell.sum()),
        episodes=episodes,
        metres=float(metres.mean()),
        seconds=float(used.mean()),
        changes=float(changes.mean()),
        shares=tuple((shares / shares.sum()).tolist()),
    )


def measured(
    file: Path,
    gaits: Gaits,
    reward: ChoiceReward,
    *,
    episodes: int = 16,
    seed: int = 1000,
    tell: Tell = silent,
) -> list[Measured]:
    """The policy of `file`, then each of its gaits alone, on its course.

    `tell` gets the control steps of all of them, of as many as there may be.
    """
    env_cfg = load_policy(file).info.env
    ways = [("chosen", chosen_by(file))]
    ways += [(f"{name} alone", alone(gaits, i)) for i, name in enumerate(gaits.names)]

    def after(before: int) -> Tell:
        return lambda done, of: tell(before * of + done, len(ways) * of)

    return [
        measure(
            name,
            act,
            gaits,
            env_cfg,
            reward,
            episodes=episodes,
            seed=seed,
            tell=after(before),
        )
        for before, (name, act) in enumerate(ways)
    ]


def table(rows: Sequence[Measured], names: Sequence[str]) -> str:
    """`rows` in columns, for people."""
    wide = max(12, *(len(row.name) + 2 for row in rows))
    lines = [f"{'':{wide}}reward  metres  finished  falls  changes  share of each gait"]
    for row in rows:
        shares = ", ".join(
            f"{name} {share:.0%}" for name, share in zip(names, row.shares, strict=True)
        )
        done = f"{row.finished} of {row.episodes}"
        lines.append(
            f"{row.name:{wide}}{row.reward:6.2f}  {row.metres:6.2f}  {done:8}  "
            f"{row.falls:5}  {row.changes:7.1f}  {shares}"
        )
    return "\n".join(lines)
