"""Training a policy on a reward."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from gaitpref.raters.criterion_scores import criterion_context
from gaitpref.training.total_reward import load_score, total_reward
from policy.env.known_terms import KnownTermsCfg
from policy.training.ppo import IterationStats, ScoreFn
from policy.training.session import TrainResult
from policy.training.setup import setting_of
from policy.training.train import train
from policy.training.train_cfg import TrainCfg


def train_on(
    reward: ScoreFn | str | Path,
    out: Path,
    *,
    steps: int,
    base: Path | None = None,
    robot: Path | None = None,
    keep_task: bool = False,
    weight: float = 1.0,
    resume: bool = False,
    on_iteration: Callable[[IterationStats], None] = lambda stats: None,
    seed: int = 0,
) -> TrainResult:
    """Train a policy on a reward and the known safety terms.

    Args:
        reward: A score of rows, the name of a criterion, or the directory of a learned
            reward.
        out: Gets the policy, and what it takes to go on.
        steps: Environment steps over all environments.
        base: A policy to begin from; None begins with a new one.
        robot: MJCF of another robot than the policy's, or than the one that ships.
        keep_task: Pay the hand-written walking reward too.
        weight: Of `reward`.
        resume: Go on from what was left in `out`.
        on_iteration: Called after every update.
        seed: Where all chance comes from.

    Raises:
        GaitprefError: a file cannot be used.
    """
    setting = setting_of(base, robot)
    name = str(reward) if isinstance(reward, str | Path) else type(reward).__name__
    if isinstance(reward, str | Path):
        reward = load_score(str(reward), criterion_context(setting.robot, setting.env))
    paid = total_reward(
        reward,
        setting.robot,
        setting.env,
        known=KnownTermsCfg(),
        weight=weight,
        keep_task=keep_task,
    )
    return train(
        out,
        setting.robot,
        TrainCfg(
            steps=steps,
            env=setting.env,
            ppo=setting.ppo,
            seed=seed,
        ),
        reward_fn=paid,
        reward_name=name,
        init=base,
        resume=resume,
        on_iteration=on_iteration,
    )
