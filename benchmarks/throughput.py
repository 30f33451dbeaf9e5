"""What an environment step costs beside the physics in it, and beside EnvPool's.

    python -m benchmarks.throughput [--quick] [--json FILE]

Five physics steps of 4 ms a control step, random actions, every part in a process of
its own, three turns of all parts in one run: the best of each counts, so that a busy
machine hurts all alike. EnvPool is measured where it is installed.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import torch
import tyro
from mujoco.batch import Batch
from rich.console import Console
from rich.progress import track
from rich.table import Table

from data.features import FEATURE_DIM
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import EnvCfg
from policy.robots.bare import bare_model
from policy.robots.robot import load_robot
from policy.training.ppo import PpoCfg, Runner, ScoreFn
from rewardmodel.answers.answered_pairs import AnsweredPairs
from rewardmodel.answers.clip_batch import ClipBatch
from rewardmodel.cfg import FitCfg
from rewardmodel.fitting.fit_reward import fit_reward

from .harness import Figure, publish

ENV = EnvCfg(physics_dt_s=0.004, substeps=5)
PARTS = ("batch", "env", "env_learned", "ppo", "ppo_learned", "envpool")
Part = Literal["batch", "env", "env_learned", "ppo", "ppo_learned", "envpool"]
ROLLOUT = 24
ENVPOOL_LIMIT = 64
"""With 256 EnvPool takes 12.6 GB and a minute to start, with 512 more than 24 GB."""
GOALS = {
    "env_over_batch": ">= 0.85",
    "env_over_envpool": ">= 1.6",
    "ppo_over_batch": ">= 0.65",
    "learned_reward_share": "<= 0.08",
    "peak_mb_4096": "<= 600",
}


@dataclass(frozen=True, kw_only=True)
class Options:
    """Measure the environment step."""

    quick: bool = False
    """Few environments, short turns."""
    sizes: tuple[int, ...] = (64, 256, 1024, 4096)
    """Environments side by side; the figures of the goals want 64, 1024 and 4096."""
    json: Path | None = None
    """Write the figures here."""
    part: Part | None = None
    """Measure this part alone and print one line of JSON."""
    envs: int = 256
    """Environments of that part."""
    turn_s: float = 4.0
    """How long a part is measured in a turn."""


def rate(step: Callable[[], int], duration_s: float) -> dict[str, float]:
    """Steps/s and CPU time per step of `step`, which tells how many steps it did."""
    step()
    start_s, cpu_s, steps = time.perf_counter(), time.process_time(), 0
    while time.perf_counter() - start_s < duration_s:
        steps += step()
    wall_s = time.perf_counter() - start_s
    return {
        "steps_per_s": steps / wall_s,
        "cpu_us": 1e6 * (time.process_time() - cpu_s) / steps,
    }


def batch_step(num_envs: int) -> Callable[[], int]:
    """Raw physics: the limit."""
    robot = load_robot(physics_dt_s=ENV.physics_dt_s)
    # The model that the environment simulates; with all that is only looked at, raw
    # physics is slower still.
    batch = Batch(bare_model(robot.mjcf, robot.mj_model), num_envs)
    home = robot.home_joint_pos
    qpos, qvel, ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
    batch.reset()
    qpos[:] = robot.home_qpos
    lowest_m = ENV.fall.height_ratio * robot.home_qpos[2]
    rng = np.random.default_rng(0)
    targets = home + ENV.action_scale_rad * rng.standard_normal((64, num_envs, 12))
    turn = iter(range(10**9))

    def step() -> int:
        ctrl[:, robot.actuator_ids] = targets[next(turn) % 64]
        batch.step(nstep=ENV.substeps)
        # Robots that lie are another problem to solve: who falls starts again, as in
        # the environment. The third entry of the last row of the base's rotation.
        upright = 1.0 - 2.0 * (qpos[:, 4] ** 2 + qpos[:, 5] ** 2)
        fallen = (qpos[:, 2] < lowest_m) | (upright < np.cos(ENV.fall.tilt_rad))
        qpos[fallen], qvel[fallen] = robot.home_qpos, 0.0
        return num_envs

    return step


def env_step(num_envs: int, *, learned: bool) -> Callable[[], int]:
    """Our environment: observations, feature row, reward, terminations, resets."""
    robot = load_robot(physics_dt_s=ENV.physics_dt_s)
    env = QuadrupedEnv(robot, ENV, num_envs, seed=0)
    actions = torch.randn(64, num_envs, 12, generator=torch.Generator().manual_seed(0))
    reward = learned_reward() if learned else None
    rows: list[torch.Tensor] = []
    starts: list[torch.Tensor] = []

    def step() -> int:
        for index in range(ROLLOUT):
            _, _, _, extras = env.step(actions[index])
            rows.append(extras["features"])
            starts.append(extras["starts"])
        if reward is not None:
            reward(torch.stack(rows), torch.stack(starts))
        rows.clear()
        starts.clear()
        return ROLLOUT * num_envs

    return torch.inference_mode()(step)


def ppo_step(num_envs: int, *, learned: bool) -> Callable[[], int]:
    """PPO from end to end."""
    robot = load_robot(physics_dt_s=ENV.physics_dt_s)
    torch.manual_seed(0)
    cfg = PpoCfg(num_envs=num_envs)
    runner = Runner(QuadrupedEnv(robot, ENV, num_envs, seed=0), cfg)
    if learned:
        runner.alg.reward_fn = learned_reward()

    def step() -> int:
        runner.learn(runner.current_learning_iteration + 1, lambda stats: True)
        return cfg.steps_per_iteration

    return step


def envpool_step(num_envs: int) -> Callable[[], int]:
    """EnvPool's joystick task of the same robot; its control step is 20 ms too."""
    import envpool  # pyright: ignore[reportMissingImports]

    env = envpool.make_gymnasium("Go1JoystickFlatTerrain-v1", num_envs=num_envs)
    env.reset()
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1.0, 1.0, (64, num_envs, 12))
    turn = iter(range(10**9))

    def step() -> int:
        env.step(actions[next(turn) % 64])
        return num_envs

    return step


def measure_part(part: Part, num_envs: int, duration_s: float) -> dict[str, float]:
    """Figures of one part, in this process."""
    before_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    made = {
        "batch": lambda: batch_step(num_envs),
        "env": lambda: env_step(num_envs, learned=False),
        "env_learned": lambda: env_step(num_envs, learned=True),
        "ppo": lambda: ppo_step(num_envs, learned=False),
        "ppo_learned": lambda: ppo_step(num_envs, learned=True),
        "envpool": lambda: envpool_step(num_envs),
    }[part]()
    figures = rate(made, duration_s)
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {**figures, "peak_mb": peak_mb - before_mb}


def in_process(part: Part, num_envs: int, duration_s: float) -> dict[str, float] | None:
    """Figures of one part, in a process of its own; None where it cannot run."""
    command = [sys.executable, "-m", "benchmarks.throughput", "--part", part]
    command += ["--envs", str(num_envs), "--turn-s", str(duration_s)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode:
        return None
    return json.loads(result.stdout.splitlines()[-1])


def learned_reward() -> ScoreFn:
    """A learned reward of the default kind; what it was fitted to costs nothing."""
    cfg, (left, right) = FitCfg(), torch.randn(2, 16, 20, FEATURE_DIM).unbind()
    valid = torch.ones(16, 20, dtype=torch.bool)
    pairs = AnsweredPairs(
        left=ClipBatch(left, valid),
        right=ClipBatch(right, valid),
        target=(torch.arange(16) % 2).float(),
        episodes=tuple((f"a{i}", f"b{i}") for i in range(16)),
        raters=("nobody",) * 16,
        commands=torch.zeros(16, 3),
        rounds=(0,) * 16,
        strategies=("uniform",) * 16,
        num_without_target=0,
        answers_sha256="",
    )
    return fit_reward(pairs, cfg, seed=0)[0]


def _best(turns: list[dict[str, float]]) -> dict[str, float]:
    return {
        "steps_per_s": max(turn["steps_per_s"] for turn in turns),
        "cpu_us": min(turn["cpu_us"] for turn in turns),
        "peak_mb": max(turn["peak_mb"] for turn in turns),
    }


def _table(results: dict[tuple[Part, int], dict[str, float]]) -> Table:
    table = Table(title="control steps of 20 ms, five physics steps each")
    for name in ("part", "environments", "steps/s", "CPU us/step", "peak MB"):
        table.add_column(name, justify="right")
    for (part, num_envs), figures in sorted(results.items()):
        values = (figures["steps_per_s"], figures["cpu_us"], figures["peak_mb"])
        table.add_row(part, str(num_envs), *(f"{value:,.0f}" for value in values))
    return table


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> None:
    """Measure everything and publish it."""
    torch.set_num_threads(1)
    if options.part is not None:
        print(json.dumps(measure_part(options.part, options.envs, options.turn_s)))
        return
    sizes = (64,) if options.quick else options.sizes
    turn_s = 0.5 if options.quick else options.turn_s
    turns: dict[tuple[Part, int], list[dict[str, float]]] = {}
    plan: list[tuple[Part, int]] = [
        (part, num_envs)
        for _ in range(1 if options.quick else 3)
        for num_envs in sizes
        for part in PARTS
        if part != "envpool" or num_envs <= ENVPOOL_LIMIT
    ]
    for part, num_envs in track(plan, "measuring", console=Console(stderr=True)):
        figures = in_process(part, num_envs, turn_s)
        if figures is not None:
            turns.setdefault((part, num_envs), []).append(figures)
    results = {key: _best(value) for key, value in turns.items()}
    Console().print(_table(results))
    publish("throughput", _figures(results, sizes), GOALS, options.json)


def _figures(
    results: dict[tuple[Part, int], dict[str, float]], sizes: tuple[int, ...]
) -> dict[str, Figure]:
    size = 1024 if 1024 in sizes else sizes[0]
    usual = 256 if 256 in sizes else sizes[0]

    def speed(part: Part, num_envs: int) -> float:
        return results[part, num_envs]["steps_per_s"]

    figures: dict[str, Figure] = {
        "env_over_batch": speed("env", size) / speed("batch", size),
        "ppo_over_batch": speed("ppo", size) / speed("batch", size),
        "learned_reward_share": 1.0 - speed("ppo_learned", size) / speed("ppo", size),
        f"ppo_steps_per_s_{usual}": speed("ppo", usual),
        f"peak_mb_{sizes[-1]}": results["env", sizes[-1]]["peak_mb"],
    }
    if ("envpool", 64) in results:
        figures["env_over_envpool"] = speed("env", size) / speed("envpool", 64)
        figures["env_over_envpool_both_64"] = speed("env", 64) / speed("envpool", 64)
    for (part, num_envs), values in results.items():
        figures[f"{part}_{num_envs}_steps_per_s"] = values["steps_per_s"]
        figures[f"{part}_{num_envs}_cpu_us"] = values["cpu_us"]
    return figures


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
