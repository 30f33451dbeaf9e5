"""States and feature rows as an episode that no policy of ours acted in.

Shapes: T steps, F columns of the feature row.
"""

from __future__ import annotations

import numpy as np

from data.episodes.episode import EndReason, Episode, EpisodeMeta
from data.features import missing_features
from policy.robots.robot import Robot


def as_episode(
    robot: Robot,
    qpos: np.ndarray,
    qvel: np.ndarray,
    rows: np.ndarray,
    *,
    dt_s: float,
    command: tuple[float, float, float],
    task: str,
    number: int,
    sha256: str,
    extra: dict[str, str],
    end_reason: EndReason = "truncated",
    action: np.ndarray | None = None,
) -> Episode:
    """An episode whose observations, targets and rewards nobody knows (NaN).

    Args:
        robot: Whose states they are.
        qpos: [T + 1, 19].
        qvel: [T + 1, 18].
        rows: [T + 1, F]; the first is left out: a row tells what a step led to.
        dt_s: Time of a step.
        command: What stands for the whole of it, by which clips are paired.
        task: Name of the task.
        number: Which of several episodes.
        sha256: Hash of where it comes from, in place of a policy's.
        extra: Kept with it, and with it what its rows lack.
        end_reason: How it ended.
        action: [T, 12], where it is known.
    """
    num_steps = len(qpos) - 1

    def unknown(*shape: int) -> np.ndarray:
        return np.full(shape, np.nan, dtype=np.float32)

    features = rows[1:].astype(np.float32)
    return Episode(
        qpos=np.array(qpos, dtype=np.float64),
        qvel=np.array(qvel, dtype=np.float64),
        obs=unknown(num_steps + 1, 48),
        action=unknown(num_steps, 12) if action is None else action.astype(np.float32),
        ctrl=unknown(num_steps, 12),
        features=features,
        reward=unknown(num_steps),
        end_reason=end_reason,
        meta=EpisodeMeta(
            task=task,
            seed=0,
            env_index=number,
            command=command,
            policy_sha256=sha256,
            policy_step=0,
            stochastic=False,
            control_dt_s=dt_s,
            physics_dt_s=dt_s,
            robot=robot.name,
            model_sha256=robot.model_sha256,
            extra=extra | {"missing_features": " ".join(missing_features(features))},
        ),
        mjcf=robot.mjcf,
    )
