"""The learned reward for RSL-RL environments that are not ours.

Shapes: N environments, F feature columns.
"""

from __future__ import annotations

from typing import Any

import torch
from rsl_rl.env import VecEnv
from tensordict import TensorDict
from torch import Tensor

from data.features import FEATURE_DIM, column
from policy.training.ppo import ScoreFn

from .step_reward import StepReward


class LearnedRewardEnv(VecEnv):
    """Any RSL-RL `VecEnv`, paid by a reward of feature rows.

    The environment has to put the rows of `data.features.FEATURES`, computed before any
    reset, into `extras["features"]` [N, F]; everything else of it stays as it is. What
    it would have paid itself is logged as `reward/env`.
    """

    def __init__(
        self,
        env: VecEnv,
        score: ScoreFn,
        *,
        step_dt_s: float,
        weight: float = 1.0,
        env_weight: float = 0.0,
        history: int | None = None,
        key: str = "features",
    ) -> None:
        """Wrap `env`.

        Args:
            env: The environment.
            score: Score per second: a learned reward or a criterion.
            step_dt_s: Time between two actions; a step earns its score times this.
            weight: Of the score.
            env_weight: Of the environment's own reward, which is added.
            history: Steps the score is shown, this one included; as many as it says it
                looks at by default.
            key: Name of the rows in `extras`.
        """
        self._env, self._score = env, StepReward(score, history=history)
        self._step_dt_s, self._weight, self._env_weight = step_dt_s, weight, env_weight
        self._key = key
        self._starts = torch.ones(env.num_envs, dtype=torch.bool, device=env.device)

    def __getattr__(self, name: str) -> Any:
        # Reached only for what this class has not: all of that is the environment's.
        return getattr(self.__dict__["_env"], name)

    @property
    def unwrapped(self) -> Any:
        """The environment below all wrappers; RSL-RL's extensions look there."""
        return getattr(self._env, "unwrapped", self._env)

    @property
    def episode_length_buf(self) -> Tensor:
        """[N] steps of the current episodes; RSL-RL sets them, too."""
        return self._env.episode_length_buf

    @episode_length_buf.setter
    def episode_length_buf(  # pyright: ignore[reportIncompatibleVariableOverride]
        self, steps: Tensor
    ) -> None:
        self._env.episode_length_buf = steps

    def get_observations(self) -> TensorDict:
        """The current observations of the environment."""
        return self._env.get_observations()

    def step(
        self, actions: Tensor
    ) -> tuple[TensorDict, Tensor, Tensor, dict[str, Any]]:
        """Step the environment; the reward [N] is the score of what it led to.

        Raises:
            ValueError: the environment supplies no feature rows, or rows of another
                width.
        """
        obs, own, dones, extras = self._env.step(actions)
        rows = extras.get(self._key)
        shape = (len(own), FEATURE_DIM)
        if rows is None or tuple(rows.shape) != shape:
            found = "nothing" if rows is None else f"an array {tuple(rows.shape)}"
            raise ValueError(
                f"extras[{self._key!r}] must hold the feature rows {shape} of the step "
                f"in the order of data.features.FEATURES, before any reset; the "
                f"environment put {found} there"
            )
        standing = 1.0 - rows[:, column("fallen")][:, 0]
        score = self._score(rows, self._starts) * standing
        earned = self._weight * self._step_dt_s * score
        self._starts = dones.bool().clone()
        log = {**extras.get("log", {}), "reward/env": own.float().mean()}
        extras = {**extras, "log": log, "env_reward": own}
        return obs, earned + self._env_weight * own, dones, extras
