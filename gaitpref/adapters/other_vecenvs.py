"""The batch of robots in the vector interfaces of rl_games and Tianshou.

Neither is imported: both take whatever has the methods they call. rl_games 1.6 wants an
`IVecEnv`, Tianshou 2.0 a `BaseVectorEnv` (their documented interfaces).

Shapes: N environments.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np

from data.errors import GaitprefError


class RlGamesVecEnv:
    """For rl_games: `vecenv.register("gaitpref", lambda name, n, **kw: ...)`.

    Give `value_bootstrap: True` in its configuration: `infos["time_outs"]` tells which
    episodes only ran out of time.
    """

    def __init__(self, envs: gymnasium.vector.VectorEnv, *, seed: int = 0) -> None:
        """Take over `envs`, as `gymnasium.make_vec` gives them."""
        self._envs, self._seed = envs, seed

    def reset(self) -> np.ndarray:
        """Start all episodes; observations [N, 48]."""
        return self._envs.reset(seed=self._seed)[0]

    def step(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Observations, rewards, ends of one step; what ended begins anew."""
        obs, rewards, terminated, truncated, _ = self._envs.step(actions)
        infos = {"time_outs": truncated.astype(np.float32)}
        return obs, rewards.astype(np.float32), terminated | truncated, infos

    def get_env_info(self) -> dict[str, Any]:
        """The spaces of one robot."""
        return {
            "observation_space": self._envs.single_observation_space,
            "action_space": self._envs.single_action_space,
            "agents": 1,
            "value_size": 1,
        }

    def get_number_of_agents(self) -> int:
        """One policy for each robot."""
        return 1

    def has_action_masks(self) -> bool:
        """Every action may be taken."""
        return False

    def seed(self, seed: int) -> None:
        """What the next `reset` begins with."""
        self._seed = seed

    def set_train_info(self, env_frames: int, *args: Any, **kwargs: Any) -> None:
        """Nothing here changes with the training."""

    def get_env_state(self) -> None:
        """Nothing has to go into a checkpoint."""

    def set_env_state(self, env_state: Any) -> None:
        """Nothing comes out of one."""


class TianshouVecEnv:
    """For Tianshou's `Collector`, collecting by steps: all robots step at once."""

    is_async = False
    waiting_id: Sequence[int] = ()

    def __init__(self, envs: gymnasium.vector.VectorEnv, *, seed: int = 0) -> None:
        """Take over `envs`, as `gymnasium.make_vec` gives them."""
        self._envs, self._seed = envs, seed
        self.env_num = envs.num_envs
        self.observation_space = [envs.single_observation_space] * self.env_num
        self.action_space = [envs.single_action_space] * self.env_num
        self._obs = np.zeros(envs.observation_space.shape or (), dtype=np.float32)

    def __len__(self) -> int:
        return self.env_num

    def reset(
        self, env_id: Sequence[int] | np.ndarray | None = None, **_: Any
    ) -> tuple[np.ndarray, np.ndarray]:
        """Observations of all after a reset, or of those that ended and began anew."""
        if env_id is None:
            self._obs = self._envs.reset(seed=self._seed)[0]
            ids = range(self.env_num)
        else:
            ids = env_id
        return self._obs[list(ids)], _facts(len(list(ids)))

    def step(
        self, action: np.ndarray, id: Sequence[int] | np.ndarray | None = None, **_: Any
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """One step of all; of an episode that ended, its last observation.

        Raises:
            GaitprefError: only some are to step.
        """
        if id is not None and len(id) != self.env_num:
            raise GaitprefError(
                f"all {self.env_num} robots step at once, {len(id)} were to; collect "
                "with n_step, a multiple of their number, and not with n_episode"
            )
        led_to = self._envs.step(np.asarray(action))
        self._obs, rewards, terminated, truncated, infos = led_to
        seen = self._obs
        if "final_obs" in infos:
            ended = infos["_final_obs"][:, None]
            seen = np.where(ended, np.stack(infos["final_obs"]), seen)
        return seen, rewards, terminated, truncated, _facts(self.env_num)

    def seed(self, seed: int | Sequence[int] | None = None) -> list[int]:
        """What the next `reset` begins with."""
        if seed is not None:
            self._seed = seed if isinstance(seed, int) else seed[0]
        return [self._seed] * self.env_num

    def get_env_attr(self, key: str, id: Any = None) -> list[Any]:
        """An attribute that all share."""
        return [getattr(self._envs, key)] * self.env_num

    def render(self, **_: Any) -> Any:
        """Pictures, where `envs` were made with a `render_mode`."""
        return self._envs.render()

    def close(self) -> None:
        """Close `envs`."""
        self._envs.close()


def _facts(count: int) -> np.ndarray:
    """What Tianshou wants beside each observation: a dictionary, here an empty one."""
    facts = np.empty(count, dtype=object)
    facts[:] = [{} for _ in range(count)]
    return facts
