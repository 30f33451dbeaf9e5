"""Stable-Baselines3's PPO on the quadruped, on the task or on a learned reward.

pip install -e '.[train,sb3]' -c constraints.txt
python examples/train_with_sb3.py --steps 1200000
python examples/train_with_sb3.py --reward runs/demo/rounds/00/reward --keep-task

`python -m benchmarks.other_trainers` trains it and says whether it walks: for each
command and from rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
import tyro
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv, VecMonitor, VecNormalize
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from gaitpref.adapters.gym_registration import ENV_ID


@dataclass(frozen=True, kw_only=True)
class ExampleCfg:
    """What is trained."""

    reward: str = "task"
    """task, a criterion, or the directory of a learned reward."""
    keep_task: bool = False
    """Keep the hand-written walking reward beside it."""
    alive: float = 1.0
    """Paid per second without a fall, beside the task; as the loop pays it."""
    steps: int = 1_200_000
    """Environment steps over all environments."""
    envs: int = 64
    """Environments side by side."""
    steps_per_env: int = 48
    """Control steps each environment contributes to one update."""
    out: Path = Path("runs/sb3.zip")
    """File of the policy."""
    seed: int = 0
    """Where all chance comes from."""


class Sb3VecEnv(VecEnv):
    """Gymnasium's vector environment the way Stable-Baselines3 wants it."""

    def __init__(self, envs: gymnasium.vector.VectorEnv, seed: int) -> None:
        self._envs, self._next_seed = envs, seed
        super().__init__(
            envs.num_envs, envs.single_observation_space, envs.single_action_space
        )
        self._actions = np.zeros(envs.action_space.shape or (), dtype=np.float32)

    def reset(self) -> np.ndarray:
        """Start all episodes."""
        obs, _ = self._envs.reset(seed=self._next_seed)
        self._next_seed += 1
        return obs

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """One step; an episode's last observation is in its `info`."""
        obs, rewards, terminated, truncated, infos = self._envs.step(self._actions)
        dones = terminated | truncated
        each: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for index in np.flatnonzero(dones):
            each[index] = {
                "terminal_observation": infos["final_obs"][index],
                "TimeLimit.truncated": bool(truncated[index]),
            }
        return obs, rewards, dones, each

    def close(self) -> None:
        """Nothing is held open."""
        self._envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute all environments share."""
        return [getattr(self._envs, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """The environments are one batch: none has attributes of its own."""
        raise NotImplementedError(f"{attr_name} of a single environment cannot be set")

    def env_method(self, method_name: str, *args: Any, **kwargs: Any) -> list[Any]:
        """The environments are one batch: none has methods of its own."""
        raise NotImplementedError(f"{method_name} cannot be called on one environment")

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Nothing is wrapped."""
        return [False] * self.num_envs


def train(cfg: ExampleCfg) -> PPO:
    """Train and save a policy."""
    # The networks are small: a second thread wins nothing.
    torch.set_num_threads(1)
    envs = gymnasium.make_vec(
        ENV_ID,
        num_envs=cfg.envs,
        reward=cfg.reward,
        keep_task=cfg.keep_task,
        alive=cfg.alive,
    )
    # As this project's own PPO: inputs of one size. The reward stays as it is.
    seen = VecNormalize(VecMonitor(Sb3VecEnv(envs, cfg.seed)), norm_reward=False)
    model = PPO(
        "MlpPolicy",
        seen,
        n_steps=cfg.steps_per_env,
        batch_size=cfg.envs * cfg.steps_per_env // 4,
        n_epochs=5,
        learning_rate=5e-4,
        ent_coef=0.003,
        target_kl=0.02,
        # An action of 1 is a large one here: start with small noise.
        policy_kwargs={"net_arch": [128, 128], "log_std_init": -1.6},
        device="cpu",
        seed=cfg.seed,
        verbose=1,
    )
    model.learn(cfg.steps)
    cfg.out.parent.mkdir(parents=True, exist_ok=True)
    model.save(cfg.out)
    seen.save(str(cfg.out.with_suffix(".inputs.pkl")))
    return model


if __name__ == "__main__":
    train(tyro.cli(ExampleCfg))
