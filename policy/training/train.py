"""Training as one stage: a reward in, a directory with a policy out, resumable."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import torch

from policy.env.randomise import make_env
from policy.env.seeding import spawned
from policy.parallel.ranks import ALONE, Ranks, others_alive
from policy.robots.robot import Robot
from policy.sim.device_memory import told_of_memory
from policy.sim.making import Device

from .checkpoint import PolicyError
from .learning import Learning
from .on_device import on_device
from .ppo import IterationStats, Runner, ScoreFn
from .session import Session, TrainResult
from .train_cfg import TrainCfg

Engine = Callable[[Robot, TrainCfg, int], Learning]
"""Makes what collects and learns, whose environments have their chance from a seed."""


def train(
    out: Path,
    robot: Robot,
    cfg: TrainCfg,
    *,
    reward_fn: ScoreFn | None = None,
    reward_name: str = "task",
    init: Path | None = None,
    resume: bool = False,
    on_iteration: Callable[[IterationStats], None] = lambda stats: None,
    ranks: Ranks = ALONE,
    engine: Engine | None = None,
) -> TrainResult:
    """Train a policy into the directory `out`.

    Args:
        out: Gets policy.pt, checkpoints/, summary.json (what the last iteration
            measured), TensorBoard files and the state to resume.
        robot: The robot.
        cfg: Sizes, lengths and seed.
        reward_fn: Reward per step of feature rows; None is the task's own.
        reward_name: What the reward is, in words.
        init: A policy file to start from.
        resume: Go on from the state left in `out`; without one, start anew.
        on_iteration: Called after every iteration.
        ranks: Processes that do this training together: each calls this with the same
            arguments, has a share of the environments and chance of its own, and the
            first one writes.
        engine: Makes what collects and learns; by default this process does both.

    Raises:
        PolicyError: `init` or the state to resume cannot be used.
        RankLost: another rank is gone.
        GaitprefError: the environments cannot be shared by the ranks, or these were
            not given the same, or what `cfg.sim` asks for cannot be had here.
    """
    out.mkdir(parents=True, exist_ok=True)
    device = _device_of(cfg)
    torch_seed, env_seed = spawned(cfg.seed, 2)
    share = ranks.share_of(cfg.ppo.num_envs)
    with _own_chance(device), told_of_memory(share), others_alive():
        torch.manual_seed(torch_seed)
        if engine is None:
            runner = _runner_here(robot, cfg, _of_rank(env_seed, ranks), ranks)
        else:
            runner = engine(robot, cfg, env_seed)
        runner.alg.reward_fn = reward_fn
        session = Session(out, robot, cfg, runner, reward_name)
        runner.alg.reward_fn = on_device(reward_fn, torch.device(runner.device))
        if init is not None:
            session.start_from(init)
        if ranks.size > 1:
            # Networks begin the same, what is tried on the way differs.
            torch.manual_seed(_of_rank(torch_seed, ranks))
        if not (resume and session.resume()):
            session.start_fresh()
        session.require_same()
        return session.run(on_iteration)


def _device_of(cfg: TrainCfg) -> Device:
    """Where it runs, seen to be there.

    Raises:
        GaitprefError: it is not, or something of the training cannot be there.
    """
    if cfg.sim is None:
        return "cpu"
    cfg.sim.require()
    if cfg.sim.device == "cuda" and cfg.ppo.bonus is not None:
        raise PolicyError(
            "the bonus for motion that is new is computed on the processor alone: "
            "leave --exploration out, or --device cuda"
        )
    return cfg.sim.device


def _runner_here(robot: Robot, cfg: TrainCfg, seed: int, ranks: Ranks) -> Runner:
    env = make_env(
        robot,
        cfg.env,
        ranks.share_of(cfg.ppo.num_envs),
        seed=seed,
        sim=cfg.sim,
        threads=ranks.threads,
        ranks=ranks,
    )
    return Runner(env, cfg.ppo, ranks)


def _of_rank(seed: int, ranks: Ranks) -> int:
    """The rank's own seed of what follows from `seed`."""
    return seed if ranks.size == 1 else spawned(seed, ranks.size)[ranks.rank]


@contextmanager
def _own_chance(device: str) -> Iterator[None]:
    """Leave PyTorch's chance outside as it was, on the device too."""
    devices = [] if device == "cpu" else [torch.cuda.current_device()]
    with torch.random.fork_rng(devices=devices):
        yield
