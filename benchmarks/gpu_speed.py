"""How fast a GPU is: steps, updates, and the time to a walk."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress

import torch
from torch import Tensor

from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import RANDOMISE, EnvCfg
from policy.env.randomise import make_env
from policy.sim.making import make_sim
from policy.sim.sim import Sim
from policy.training.ppo import IterationStats, PpoCfg, Runner
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from policy.training.training_dir import CHECKPOINTS_NAME

from .gpu_bench import ENV, Bench, Row
from .until_it_walks import look


def first(bench: Bench) -> None:
    """How long the first control step takes, kernels to be compiled included."""
    made: list[Sim] = []

    def make() -> None:
        made.append(make_sim(bench.robot, 1, bench.cfg))

    make_s = bench.seconds(make)
    step_s = bench.seconds(lambda: made[0].advance(ENV.substeps))
    again_s = bench.seconds(lambda: made[0].advance(ENV.substeps))
    captured_s = bench.seconds(lambda: made[0].advance(ENV.substeps))
    bench.write(
        "first",
        {
            "make_s": make_s,
            "first_step_s": step_s,
            "second_step_s": again_s,
            "third_step_s": captured_s,
        },
    )


def speed(bench: Bench, count: int, step: Callable[[], object]) -> Row:
    """Control steps per second of all worlds together."""
    for _ in range(3):
        step()
    steps, bench_s = 0, 0.0
    while bench_s < bench.options.turn_s:
        bench_s += bench.seconds(lambda: [step() for _ in range(10)])
        steps += 10
    return {
        "worlds": count,
        "steps_per_s": count * steps / bench_s,
        "ms_per_step": 1e3 * bench_s / steps,
        "used_mb": bench.used_mb(),
    }


@torch.inference_mode()
def bare(bench: Bench) -> None:
    """The simulator alone: targets in, four physics steps."""
    for count in bench.options.sizes:
        sim = make_sim(bench.robot, count, bench.cfg)
        home = torch.tensor(bench.robot.home_qpos, device=sim.device)
        everyone = sim.rows(torch.ones(count, dtype=torch.bool, device=sim.device))
        assert everyone is not None
        nv = bench.robot.mj_model.nv
        still = torch.zeros(count, nv, dtype=torch.float64, device=sim.device)
        sim.reset(everyone, home.repeat(count, 1), still)
        targets = torch.tensor(
            bench.robot.home_joint_pos, dtype=torch.float32, device=sim.device
        )
        targets = targets + 0.1 * bench.actions(count)
        turn = iter(range(10**9))

        def step(sim: Sim = sim, targets: Tensor = targets, turn=turn) -> None:
            sim.set_targets(targets[next(turn) % 16])
            sim.advance(ENV.substeps)

        bench.write(f"bare-{count}", speed(bench, count, step))
        del sim, step


@torch.inference_mode()
def environment(bench: Bench, *, varied: bool) -> None:
    """Observations, feature rows, terminations and resets as well."""
    cfg = EnvCfg(randomise=RANDOMISE["full" if varied else "off"])
    for count in bench.options.sizes:
        env = make_env(bench.robot, cfg, count, seed=0, sim=bench.cfg)
        actions = bench.actions(count, scale=0.5)
        turn = iter(range(10**9))

        def step(env: QuadrupedEnv = env, actions: Tensor = actions, turn=turn) -> None:
            env.step(actions[next(turn) % 16], score=False)

        name = "varied" if varied else "env"
        bench.write(f"{name}-{count}", speed(bench, count, step))
        del env, step


def ppo(bench: Bench) -> None:
    """PPO from end to end, as `gaitpref train` runs it."""
    options = bench.options
    torch.manual_seed(0)
    env = make_env(bench.robot, ENV, options.envs, seed=0, sim=bench.cfg)
    cfg = PpoCfg(num_envs=options.envs)
    runner = Runner(env, cfg)
    rates: list[IterationStats] = []

    def note(stats: IterationStats) -> bool:
        rates.append(stats)
        return True

    warm = min(5, options.iterations)
    runner.learn(warm, note)
    rates.clear()
    wall_s = bench.seconds(lambda: runner.learn(warm + options.iterations, note))
    collect_s = sum(stats.scalars["perf/collect_s"] for stats in rates)
    bench.write(
        f"ppo-{options.envs}",
        {
            "worlds": options.envs,
            "iterations": options.iterations,
            "steps_per_s": options.iterations * cfg.steps_per_iteration / wall_s,
            "collect_share": collect_s / wall_s,
            "mean_return": rates[-1].mean_return,
            "peak_torch_mb": (
                torch.cuda.max_memory_allocated() / 2**20 if bench.cuda else 0.0
            ),
            "used_mb": bench.used_mb(),
        },
    )


def profile(bench: Bench) -> None:
    """Where the time of one iteration of PPO goes, as a table of kernels."""
    env = make_env(bench.robot, ENV, bench.options.envs, seed=0, sim=bench.cfg)
    runner = Runner(env, PpoCfg(num_envs=bench.options.envs))
    runner.learn(3, lambda stats: True)
    bench.wait()
    with torch.profiler.profile() as told:
        runner.learn(4, lambda stats: True)
        bench.wait()
    by = "self_cuda_time_total" if bench.cuda else "self_cpu_time_total"
    table = told.key_averages().table(
        sort_by=by, row_limit=40, max_name_column_width=60
    )
    bench.options.out.mkdir(parents=True, exist_ok=True)
    (bench.options.out / "profile.txt").write_text(table)
    print(table, flush=True)


def walk(bench: Bench) -> None:
    """From nothing to a policy that walks, on the task's reward, for each seed."""
    for seed in bench.options.seeds:
        bench.write(f"walk-{seed}", _walk(bench, seed))


def _walk(bench: Bench, seed: int) -> Row:
    options = bench.options
    out = options.work / f"walk-{seed}-{int(time.time())}"
    ppo_cfg = PpoCfg(num_envs=options.envs)
    iterations = options.walk_iterations
    cfg = TrainCfg(
        steps=iterations * ppo_cfg.steps_per_iteration,
        env=ENV,
        ppo=ppo_cfg,
        seed=seed,
        checkpoints=iterations // options.walk_every - 1,
        save_every=10**9,
        sim=bench.cfg,
    )
    start, start_s = time.time(), time.perf_counter()
    last: list[IterationStats] = []

    class Over(Exception):
        """The time is over."""

    def note(stats: IterationStats) -> None:
        last[:] = [stats]
        if time.perf_counter() - start_s > options.walk_s:
            raise Over

    with suppress(Over):
        train(out, bench.robot, cfg, on_iteration=note)
    row: Row = {"seed": seed, "worlds": options.envs, "walk_s": None}
    row |= {"trained_s": time.perf_counter() - start_s, "steps": last[0].steps}
    row["mean_return"] = last[0].mean_return
    for path in sorted((out / CHECKPOINTS_NAME).glob("*.pt")):
        looked = look(path, episodes=64)
        row["tracking_error_m_s"] = looked.evaluation.tracking_error_m_s
        if looked.walking.walks:
            row["walk_s"] = path.stat().st_mtime - start
            row["steps"] = looked.steps
            break
    return row
