"""Do the examples with other trainers walk: `python -m benchmarks.other_trainers`.

Each is trained for the steps it names, and looked at as policies of this project are:
for each command and from rest. What was trained is kept in `--work` and not repeated.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import torch
import tyro
from torch import Tensor

from data.errors import GaitprefError
from gaitpref.raters.criterion_scores import criterion_context
from gaitpref.training.total_reward import load_score
from policy.env.env_cfg import EnvCfg
from policy.robots.robot import load_robot
from policy.rollouts.evaluate import rollout_features, summarise
from policy.rollouts.rollout import Actor
from policy.rollouts.walking import table, walking

from .harness import Figure, publish

Trainer = Literal["one_file", "sb3"]


@dataclass(frozen=True, kw_only=True)
class Options:
    """Train the examples on the task and look whether they walk."""

    trainers: tuple[Trainer, ...] = ("one_file", "sb3")
    """examples/ppo_in_one_file.py, and examples/train_with_sb3.py (extra `sb3`)."""
    steps: int | None = None
    """Environment steps of each; by default those it names."""
    seed: int = 0
    """Of the trainings."""
    episodes: int = 64
    """Episodes of a look."""
    work: Path = Path("runs/benchmark-other-trainers")
    """Directory of what was trained."""
    quick: bool = False
    """A small version that shows that everything runs; its figures mean nothing."""
    json: Path | None = None
    """File for the figures."""


class Acting:
    """Somebody's policy as this project's environment asks it: without noise, clipped
    and scaled as the Gymnasium environment does."""

    def __init__(self, mean: Callable[[Tensor], Tensor]) -> None:
        self._mean = mean

    @torch.inference_mode()
    def __call__(self, obs: Tensor, noise: Tensor | None = None) -> Tensor:
        """Actions [N, 12] for `obs` [N, 48]."""
        return self._mean(obs).clamp(-1, 1) * EnvCfg().action_limit


def one_file(options: Options) -> tuple[Acting, int]:
    """PPO as CleanRL has it, and its steps."""
    from examples.ppo_in_one_file import Agent, ExampleCfg, train

    cfg = ExampleCfg(out=options.work / "one_file" / "ppo.pt", seed=options.seed)
    cfg = replace(cfg, steps=options.steps or cfg.steps)
    if options.quick:
        cfg = replace(cfg, steps=192, envs=4, steps_per_env=16)
    if not cfg.out.exists():
        train(cfg)
    agent = Agent(48, 12)
    agent.load_state_dict(torch.load(cfg.out, weights_only=True))
    agent.eval()
    return Acting(lambda obs: agent.policy(obs).mean), cfg.steps


def sb3(options: Options) -> tuple[Acting, int]:
    """Stable-Baselines3's PPO, and its steps."""
    import gymnasium
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecNormalize

    from examples.train_with_sb3 import ExampleCfg, Sb3VecEnv, train
    from gaitpref.adapters.gym_registration import ENV_ID

    cfg = ExampleCfg(out=options.work / "sb3" / "sb3.zip", seed=options.seed)
    cfg = replace(cfg, steps=options.steps or cfg.steps)
    if options.quick:
        cfg = replace(cfg, steps=192, envs=4, steps_per_env=16)
    inputs = cfg.out.with_suffix(".inputs.pkl")
    if not inputs.exists():
        train(cfg)
    model = PPO.load(cfg.out, device="cpu")
    envs = Sb3VecEnv(gymnasium.make_vec(ENV_ID, num_envs=1), 0)
    seen = VecNormalize.load(str(inputs), envs)

    def mean(obs: Tensor) -> Tensor:
        action, _ = model.predict(seen.normalize_obs(obs.numpy()), deterministic=True)
        return torch.as_tensor(action)

    return Acting(mean), cfg.steps


TRAINERS: dict[Trainer, Callable[[Options], tuple[Acting, int]]] = {
    "one_file": one_file,
    "sb3": sb3,
}


def figures_of(name: Trainer, actor: Actor, options: Options) -> dict[str, Figure]:
    """What a look at the robot that ships says of a policy."""
    env = EnvCfg()
    robot = load_robot(physics_dt_s=env.physics_dt_s)
    episodes = 8 if options.quick else options.episodes
    seen = rollout_features(actor, robot, env, episodes=episodes, seed=0)
    score = load_score("task", criterion_context(robot, env))
    result = summarise(*seen, score, control_dt_s=env.control_dt_s)
    walked = walking(actor, robot, env, *seen, seed=0)
    print(name)
    print(table(walked), flush=True)
    return {
        f"{name}_walks": walked.walks,
        f"{name}_tracking_error_m_s": result.tracking_error_m_s,
        f"{name}_falls": result.falls,
        f"{name}_never_set_off": sum(row.never_set_off for row in walked.commands),
        f"{name}_commands_from_rest": sum(row.walks for row in walked.from_rest),
    }


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> int:
    """Train what is not there yet, look, publish."""
    figures: dict[str, Figure] = {"seed": options.seed}
    goals: dict[str, str] = {}
    for name in options.trainers:
        begun_s = time.perf_counter()
        actor, steps = TRAINERS[name](options)
        figures[f"{name}_steps"] = steps
        figures[f"{name}_wall_s"] = round(time.perf_counter() - begun_s, 1)
        figures |= figures_of(name, actor, options)
        goals[f"{name}_walks"] = "True"
        publish("Other trainers", figures, goals, options.json)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main(tyro.cli(Options, config=(tyro.conf.OmitArgPrefixes,))))
    except GaitprefError as error:
        sys.exit(f"benchmarks.other_trainers: {error}")
