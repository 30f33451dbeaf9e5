"""One episode in each of N environments, step by step.

Shapes: N environments, F feature columns.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from policy.env.env import QuadrupedEnv


class Actor(Protocol):
    """Anything that acts: a `Policy`, or a test's own."""

    def __call__(self, obs: Tensor, noise: Tensor | None = None) -> Tensor:
        """Actions [N, 12] for `obs` [N, D] and standard normal draws [N, 12]."""
        ...


def hold_home(obs: Tensor, noise: Tensor | None = None) -> Tensor:
    """The actor every gait is measured against: hold the home pose."""
    return torch.zeros(len(obs), 12)


@dataclass(frozen=True, eq=False)
class RolloutStep:
    """What one control step started from and led to, for all environments."""

    qpos: Tensor
    """[N, nq] before the step, full precision"""
    qvel: Tensor
    """[N, nv] before the step"""
    obs: Tensor
    """[N, 48] before the step, as policies of this project see it"""
    action: Tensor
    """[N, 12] as the robot got it, clipped to the action limit"""
    targets: Tensor
    """[N, 12] joint targets, rad"""
    features: Tensor
    """[N, F] after the step"""
    reward: Tensor
    """[N] the task's reward"""
    alive: Tensor
    """[N] the environment's first episode was still going on before the step"""
    fallen: Tensor
    """[N] this step ended that episode by a fall"""
    aborted: Tensor
    """[N] this step ended it because the simulation diverged"""
    final: tuple[Tensor, Tensor, Tensor] | None
    """qpos, qvel, obs after the step and before any reset, where the env keeps them"""


@torch.inference_mode()
def first_episodes(
    actor: Actor,
    env: QuadrupedEnv,
    *,
    noise: Tensor | None = None,
    rng: torch.Generator | None = None,
) -> Iterator[RolloutStep]:
    """Step a fresh `env` until the first episode of every environment has ended.

    Args:
        actor: Who acts.
        env: A fresh environment; its later episodes are to be ignored by `alive`.
        noise: Scale [N] of the exploration noise per environment; None for none.
        rng: Source of that noise.
    """
    alive = torch.ones(env.num_envs, dtype=torch.bool)
    while alive.any():
        draws = None
        if noise is not None:
            draws = noise[:, None] * torch.randn(env.num_envs, 12, generator=rng)
        step, dones = one_step(actor, env, alive, draws)
        yield step
        alive &= ~dones


@torch.inference_mode()
def one_step(
    actor: Actor, env: QuadrupedEnv, alive: Tensor, draws: Tensor | None = None
) -> tuple[RolloutStep, Tensor]:
    """One control step of `env`, and which environments [N] it ended.

    Args:
        actor: Who acts.
        env: What is stepped.
        alive: [N] the environment's first episode is still going on.
        draws: Standard normal draws [N, 12] times the scale of the noise, if any.
    """
    qpos, qvel = env.sim.raw_state()
    obs, own = env.get_observations()["policy"], env.own_obs
    limit = env.cfg.action_limit
    action = actor(obs, draws).clamp(-limit, limit)
    _, reward, dones, extras = env.step(action)
    step = RolloutStep(
        qpos=qpos,
        qvel=qvel,
        obs=own,
        action=action,
        targets=extras["targets"],
        features=extras["features"],
        reward=reward,
        alive=alive.clone(),
        fallen=extras["fallen"] & alive,
        aborted=extras["aborted"] & alive,
        final=extras.get("final"),
    )
    return step, dones
