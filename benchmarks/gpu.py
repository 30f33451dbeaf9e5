"""What `--device cuda` is worth, and whether it does what the CPU does.

    python -m benchmarks.gpu [--device cpu] [--quick] [--parts NAME ...]

Checks come first: features against MuJoCo's on the CPU, resets of some robots, robots
that diverge. Then steps per second of the bare simulator, of the environment and of PPO
from end to end, memory, and the time from nothing to a walk. Every part writes its row,
with the name of the card, as soon as it is known; `python -m benchmarks.gpu_table` puts
them into `docs/benchmarks.md`.
"""

from __future__ import annotations

import json
import platform
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Literal, get_args

import torch
import tyro
from torch import Tensor

from data.features import column
from data.files.files import write_atomically
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import RANDOMISE, EnvCfg
from policy.env.feature_row import base_state
from policy.env.randomise import make_env
from policy.robots.robot import load_robot
from policy.rollouts.evaluate import evaluate
from policy.sim.making import Device, SimCfg, make_sim
from policy.sim.sim import Sim
from policy.training.checkpoint import load_policy
from policy.training.ppo import IterationStats, PpoCfg, Runner
from policy.training.train import CHECKPOINTS_NAME, TrainCfg, train

from .harness import Figure

ENV = EnvCfg()
Part = Literal[
    "first",
    "parity",
    "reset",
    "diverged",
    "bare",
    "env",
    "varied",
    "ppo",
    "walk",
    "profile",
]
PARTS: tuple[Part, ...] = get_args(Part)
MOST_APART = 1e-3
"""Largest difference of a feature, as a share of one plus its size."""
Row = dict[str, Figure]


@dataclass(frozen=True, kw_only=True)
class Options:
    """Check and measure the GPU."""

    device: Device = "cuda"
    """Where the worlds are; `cpu` is Warp's own, which shows that everything runs."""
    parts: tuple[Part, ...] = PARTS
    """What is done, in this order."""
    sizes: tuple[int, ...] = (1024, 4096, 8192)
    """Worlds side by side whose speed is measured."""
    envs: int = 4096
    """Worlds of the checks, of PPO and of the walk."""
    turn_s: float = 5.0
    """How long one speed is measured."""
    iterations: int = 50
    """Iterations of PPO that are measured, behind five others."""
    walk_s: float = 90.0
    """When a training that does not walk is ended."""
    seed: int = 0
    """Of the walk."""
    out: Path = Path("docs/results/gpu")
    """Directory of the rows."""
    work: Path = Path("runs/benchmark-gpu")
    """Directory of the trainings."""
    quick: bool = False
    """Few worlds, short turns; the figures mean nothing."""


class Bench:
    """One run of the script on one device."""

    def __init__(self, options: Options) -> None:
        self.options = options
        self.cfg = SimCfg(device=options.device, kind="warp")
        self.cfg.require()
        self.robot = load_robot(physics_dt_s=ENV.physics_dt_s)
        self.cuda = options.device == "cuda"
        self.card = torch.cuda.get_device_name() if self.cuda else "Warp's CPU device"

    def write(self, name: str, row: Row) -> None:
        """Print a row and keep it as a file."""
        told: Row = {
            "part": name,
            "card": self.card,
            "torch": torch.__version__,
            "python": platform.python_version(),
            **row,
        }
        print(json.dumps(told), flush=True)
        self.options.out.mkdir(parents=True, exist_ok=True)
        path = self.options.out / f"{name}.json"
        write_atomically(path, (json.dumps(told, indent=1) + "\n").encode())

    def wait(self) -> None:
        """Until the device has done all it was told."""
        if self.cuda:
            torch.cuda.synchronize()

    def seconds(self, work: Callable[[], object]) -> float:
        """Wall-clock time of `work`, waited for."""
        self.wait()
        start_s = time.perf_counter()
        work()
        self.wait()
        return time.perf_counter() - start_s

    def used_mb(self) -> float:
        """Memory of the device in use, by whomever."""
        if not self.cuda:
            return 0.0
        free, whole = torch.cuda.mem_get_info()
        return (whole - free) / 2**20

    def actions(self, num_envs: int, *, scale: float = 1.0) -> Tensor:
        """Random actions [16, N, 12], to be gone through in turn."""
        rng = torch.Generator().manual_seed(0)
        draws = scale * torch.randn(16, num_envs, 12, generator=rng)
        return draws.to(self.options.device)


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


@torch.inference_mode()
def parity(bench: Bench) -> None:
    """Features and contacts after 50 control steps against those of the CPU."""
    count = bench.options.envs
    ours = make_env(bench.robot, ENV, count, seed=0, sim=bench.cfg)
    theirs = make_env(bench.robot, ENV, count, seed=0)
    qpos, qvel = theirs.sim.raw_state()
    where = ours.device
    everyone = ours.sim.rows(torch.ones(count, dtype=torch.bool, device=where))
    assert everyone is not None
    ours.sim.reset(everyone, qpos.to(where), qvel.to(where))
    ours.command = theirs.command.to(where)
    actions = 0.5 * torch.randn(
        50, count, 12, generator=torch.Generator().manual_seed(1)
    )
    rows: list[Tensor] = []
    for env in (ours, theirs):
        each = [stepped(env, action.to(env.device)) for action in actions]
        rows.append(each[-1].cpu())
    apart = ((rows[0] - rows[1]).abs() / (1 + rows[1].abs())).amax(dim=1)
    ours_touch, theirs_touch = (row[:, column("foot_contact")] for row in rows)
    alike = (ours_touch == theirs_touch).float().mean()
    within = float((apart <= MOST_APART).float().mean())
    bench.write(
        "parity",
        {
            "worlds": count,
            "within_1e-3": within,
            "median_apart": float(apart.median()),
            "contacts_alike": float(alike),
            "passed": within >= 0.95 and bool(alike >= 0.99),
        },
    )


def stepped(env: QuadrupedEnv, action: Tensor) -> Tensor:
    """Feature rows [N, F] of one control step without any reset."""
    previous, env.action = env.action, action
    env.sim.set_targets(env.targets(action))
    env.sim.advance(env.cfg.substeps)
    state = env.sim.read()
    return env._features(base_state(state), state, previous)[0]


@torch.inference_mode()
def reset(bench: Bench) -> None:
    """A reset of every third robot leaves the others as they were, to the last bit."""
    count = bench.options.envs
    env = make_env(bench.robot, ENV, count, seed=0, sim=bench.cfg)
    for action in bench.actions(count):
        env.step(action)
    before = env.sim.snapshot()
    mask = torch.arange(count, device=env.device) % 3 == 0
    rows = env.sim.rows(mask)
    assert rows is not None
    qpos, qvel = (state * 0 for state in env.sim.raw_state())
    qpos += torch.tensor(bench.robot.home_qpos, device=env.device)
    env.sim.reset(rows, qpos, qvel)
    env.sim.read()
    after = env.sim.snapshot()
    others = bool((before[~mask] == after[~mask]).all())
    fresh = bool(((env.sim.raw_state()[0] - qpos)[mask].abs() < 1e-5).all())
    bench.write(
        "reset",
        {"worlds": count, "others_alike": others, "reset": fresh, "passed": others},
    )


@torch.inference_mode()
def diverged(bench: Bench) -> None:
    """A robot that is no number any more is found, ended and started anew."""
    count = bench.options.envs
    env = make_env(bench.robot, ENV, count, seed=0, sim=bench.cfg)
    actions = bench.actions(count)
    env.step(actions[0])
    poisoned = actions[1].clone()
    poisoned[1] = float("nan")
    _, _, dones, extras = env.step(poisoned)
    found = extras["aborted"].nonzero().flatten().tolist()
    obs = env.step(actions[2])[0]["policy"]
    sound = bool(obs.isfinite().all()) and bool(dones[1])
    bench.write(
        "diverged",
        {"found": str(found), "sound": sound, "passed": found == [1] and sound},
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

    runner.learn(5, note)
    rates.clear()
    wall_s = bench.seconds(lambda: runner.learn(5 + options.iterations, note))
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
    """From nothing to a policy that walks, on the task's reward."""
    options = bench.options
    out = options.work / f"walk-{options.seed}-{int(time.time())}"
    ppo_cfg = PpoCfg(num_envs=options.envs)
    iterations = 400
    cfg = TrainCfg(
        steps=iterations * ppo_cfg.steps_per_iteration,
        env=ENV,
        ppo=ppo_cfg,
        seed=options.seed,
        checkpoints=iterations // 5 - 1,
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
    row: Row = {"seed": options.seed, "worlds": options.envs, "walk_s": None}
    row |= {"trained_s": time.perf_counter() - start_s, "steps": last[0].steps}
    row["mean_return"] = last[0].mean_return
    files = sorted((out / CHECKPOINTS_NAME).glob("*.pt"))
    for path in files:
        result = evaluate(load_policy(path), _no_score, episodes=64)
        stands = result.falls == 0 and result.aborted == 0
        row["tracking_error_m_s"] = result.tracking_error_m_s
        if stands and result.tracking_error_m_s <= 0.20:
            row["walk_s"] = path.stat().st_mtime - start
            row["steps"] = load_policy(path).info.steps
            break
    bench.write(f"walk-{options.seed}", row)


def _no_score(features: Tensor, starts: Tensor) -> Tensor:
    return torch.zeros(starts.shape)


DONE_BY: dict[Part, Callable[[Bench], None]] = {
    "first": first,
    "parity": parity,
    "reset": reset,
    "diverged": diverged,
    "bare": bare,
    "env": partial(environment, varied=False),
    "varied": partial(environment, varied=True),
    "ppo": ppo,
    "walk": walk,
    "profile": profile,
}


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> None:
    """Do the parts in turn."""
    if options.quick:
        options = Options(
            device=options.device,
            parts=options.parts,
            sizes=(64,),
            envs=64,
            turn_s=0.5,
            iterations=2,
            walk_s=10.0,
            out=options.out,
            work=options.work,
        )
    bench = Bench(options)
    for part in options.parts:
        start_s = time.perf_counter()
        DONE_BY[part](bench)
        print(f"{part}: {time.perf_counter() - start_s:.1f} s in all", flush=True)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
