"""How good a policy is: a fixed grid of commands, no exploration noise.

Shapes: T steps, N episodes, F feature columns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from data.features import column
from data.files.telling import Tell, silent
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import EnvCfg
from policy.robots.robot import Robot
from policy.training.checkpoint import Policy, PolicyError
from policy.training.reward_ppo import ScoreFn, require_finite

from .rollout import Actor, first_episodes

GRID_SPEEDS = 8
"""Forward speeds of the grid, evenly spaced."""


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """Means over the episodes of one evaluation."""

    return_mean: float
    """Mean over episodes of the sum of score times control step."""
    return_ci95: float
    """Half-width of the 95 % interval of `return_mean`."""
    score_mean: float
    """Mean score of a step: the return without the length of the episode."""
    episode_length_s: float
    tracking_error_m_s: float
    """Mean over steps of the distance between planar velocity and command."""
    yaw_error_rad_s: float
    """Mean over steps of the absolute error of the turning rate."""
    falls_per_minute: float
    """Falls per minute of robot time."""
    falls: int
    aborted: int
    """Episodes whose simulation diverged; left out of everything else."""
    power_w: float
    """Mean of the summed absolute mechanical power of the joints."""
    episodes: int


def command_grid(cfg: EnvCfg, episodes: int) -> Tensor:
    """Commands [N, 3]: forward speeds over `evaluated_m_s`, in turn."""
    speeds = torch.linspace(*cfg.commands.evaluated_m_s, GRID_SPEEDS)
    command = torch.zeros(episodes, 3)
    command[:, 0] = speeds[torch.arange(episodes) % GRID_SPEEDS]
    return command


def rollout_features(
    actor: Actor,
    robot: Robot,
    cfg: EnvCfg,
    *,
    episodes: int,
    seed: int,
    tell: Tell = silent,
) -> tuple[Tensor, Tensor]:
    """Feature rows [T, N, F] over the grid, and the episodes' lengths [N].

    Rows behind an episode's end are zero; an aborted episode has length 0. `tell` gets
    the control steps that are done, and how many there are.
    """
    env = QuadrupedEnv(robot, cfg, episodes, seed=seed)
    env.fix_commands(command_grid(cfg, episodes))
    rows, lengths = [], torch.zeros(episodes, dtype=torch.long)
    aborted = torch.zeros(episodes, dtype=torch.bool)
    for step in first_episodes(actor, env):
        rows.append(step.features * step.alive[:, None])
        lengths += step.alive
        aborted |= step.aborted
        tell(len(rows), cfg.episode_steps)
    lengths[aborted] = 0
    return torch.stack(rows), lengths


def evaluate(
    policy: Policy,
    score_fn: ScoreFn,
    *,
    episodes: int = 64,
    seed: int = 0,
    env: EnvCfg | None = None,
    tell: Tell = silent,
) -> Evaluation:
    """Roll `policy` out on the grid and score it.

    Args:
        policy: Acts without exploration noise.
        score_fn: Score per second; an episode's return is its sum times the step.
        episodes: Number of episodes, spread over the grid.
        seed: Start states.
        env: Where it acts; by default where it was trained.
        tell: As of `rollout_features`.

    Raises:
        ValueError: there is no episode, or all simulations diverged.
    """
    if episodes < 1:
        raise ValueError(f"an evaluation needs at least 1 episode, got {episodes}")
    cfg = env or policy.info.env
    features, lengths = rollout_features(
        policy, policy.robot(), cfg, episodes=episodes, seed=seed, tell=tell
    )
    return summarise(features, lengths, score_fn, control_dt_s=cfg.control_dt_s)


def summarise(
    features: Tensor, lengths: Tensor, score_fn: ScoreFn, *, control_dt_s: float
) -> Evaluation:
    """`Evaluation` of rows [T, N, F] of episodes with `lengths` [N]; 0 is aborted."""
    kept = lengths > 0
    if not kept.any():
        raise PolicyError(
            "every simulation diverged, so there is nothing to evaluate: the policy's "
            "actions are wild, or the robot's model is unstable; give an earlier "
            "checkpoint, or look at the robot with `gaitpref robot inspect`"
        )
    features, lengths_kept = features[:, kept], lengths[kept]
    steps = torch.arange(len(features))[:, None]
    valid = (steps < lengths_kept).float()
    starts = (steps == 0).expand_as(valid)
    scores = require_finite(score_fn(features, starts)) * valid
    returns = (scores.sum(dim=0) * control_dt_s).double().numpy()
    velocity_error = torch.linalg.vector_norm(
        features[..., column("command")][..., :2]
        - features[..., column("base_lin_vel_b")][..., :2],
        dim=-1,
    )
    yaw_error = (
        features[..., column("command")][..., 2]
        - features[..., column("base_ang_vel_b")][..., 2]
    ).abs()
    power = features[..., column("joint_torque")] * features[..., column("joint_vel")]
    total = valid.sum()
    minutes = float(total) * control_dt_s / 60.0
    falls = int(features[..., column("fallen")].sum())

    def mean(values: Tensor) -> float:
        return float((values * valid).sum() / total)

    count = len(returns)
    spread = float(np.std(returns, ddof=1)) if count > 1 else float("nan")
    return Evaluation(
        return_mean=float(returns.mean()),
        return_ci95=1.96 * spread / count**0.5,
        score_mean=float(scores.sum() / total),
        episode_length_s=float(lengths_kept.float().mean()) * control_dt_s,
        tracking_error_m_s=mean(velocity_error),
        yaw_error_rad_s=mean(yaw_error),
        falls_per_minute=falls / minutes,
        falls=falls,
        aborted=int((~kept).sum()),
        power_w=mean(power.abs().sum(dim=-1)),
        episodes=count,
    )
