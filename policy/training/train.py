"""Training as one stage: a reward in, a directory with a policy out, resumable."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch.utils.tensorboard.writer import SummaryWriter

from data.files.files import sha256_file, write_atomically
from data.files.plain import ADDED_LATER, NONE_AS_BEFORE, to_plain
from data.files.weights import not_finite
from policy.env.env_cfg import EnvCfg
from policy.env.randomise import make_env
from policy.env.seeding import spawned
from policy.law.origin import Origin
from policy.parallel.ranks import ALONE, Ranks, others_alive
from policy.robots.robot import Robot
from policy.sim.device_memory import told_of_memory
from policy.sim.making import Device, SimCfg

from .checkpoint import (
    PolicyError,
    PolicyInfo,
    policy_info,
    read_plain,
    save_policy,
    saved_bytes,
)
from .identity import content_of, differences
from .interrupts import interrupts
from .learning import Learning
from .on_device import on_device
from .ppo import IterationStats, PpoCfg, Runner, ScoreFn
from .written import as_written

RESUME_NAME = "resume.pt"
POLICY_NAME = "policy.pt"
CHECKPOINTS_NAME = "checkpoints"
SUMMARY_NAME = "summary.json"


@dataclass(frozen=True, kw_only=True)
class TrainCfg:
    """One training run."""

    steps: int = 1_500_000
    """Environment steps over all environments."""
    env: EnvCfg
    """The environment."""
    ppo: PpoCfg
    """The algorithm."""
    seed: int = 0
    """Where all chance comes from."""
    checkpoints: int = 4
    """Policies kept on the way, evenly spaced, so that clips of them can differ."""
    save_every: int = 20
    """Iterations between two states a killed run can go on from."""
    exploration_std: float | None = None
    """Exploration noise to start from instead of that of the initial policy."""
    final_std: float | None = None
    """The most exploration noise there may be at the end, come down to linearly; a gait
    that only noise sets going is no gait."""
    sim: SimCfg | None = field(default=None, metadata=NONE_AS_BEFORE)
    """Where it runs; None is the CPU, on its threads."""
    calm_from: float = field(default=0.0, metadata=ADDED_LATER)
    """Share of the training after which it comes down, from the algorithm's `init_std`;
    at 0 from `exploration_std`, if that is given."""

    def std_limit(self, iteration: int) -> float | None:
        """The most exploration noise there may be after `iteration`."""
        if self.final_std is None:
            return None
        first = self.ppo.init_std
        if self.exploration_std is not None and not self.calm_from:
            first = self.exploration_std
        done = min(1.0, iteration / max(1, self.iterations))
        calm = max(0.0, done - self.calm_from) / max(1.0 - self.calm_from, 1e-9)
        return first + calm * (self.final_std - first)

    @property
    def iterations(self) -> int:
        """Updates it takes to reach `steps`."""
        return -(-self.steps // self.ppo.steps_per_iteration)

    @property
    def checkpoint_iterations(self) -> frozenset[int]:
        """Iterations after which a policy is kept, the last one left out."""
        parts = self.checkpoints + 1
        return frozenset(self.iterations * i // parts for i in range(1, parts)) - {0}


@dataclass(frozen=True, kw_only=True)
class TrainResult:
    """How a training run ended."""

    finished: bool
    """False where it was interrupted; it can be resumed."""
    steps: int
    policy: Path
    stats: IterationStats | None
    """The last iteration; None where there was nothing to do."""


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
        session = _Session(out, robot, cfg, runner, reward_name)
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


class _Session:
    """One process's work on a training directory."""

    def __init__(
        self, out: Path, robot: Robot, cfg: TrainCfg, runner: Learning, reward_name: str
    ) -> None:
        self.out, self.robot, self.cfg, self.runner = out, robot, cfg, runner
        self.ranks = runner.ranks
        self.reward_name = reward_name
        self.steps_before = 0
        self.origin: Origin | None = None
        # Before anything is scored: what a reward keeps of a rollout is not what it is.
        self.identity = self._identity()
        """What must be equal for a run to be the same run."""

    def start_from(self, init: Path) -> None:
        """Take over the networks of a policy file."""
        payload = read_plain(init)
        info = policy_info(init, payload)
        self.runner.start_from(init, payload)
        self.origin = info.origin
        self.steps_before = info.steps
        self.identity["init"] = sha256_file(init)

    def start_fresh(self) -> None:
        """Prepare the first iteration."""
        std = self.runner.std
        if self.cfg.exploration_std is not None and std is not None:
            std.fill_(self.cfg.exploration_std)
        self.runner.begin()

    @property
    def _steps(self) -> int:
        """Environment steps so far."""
        done = self.runner.current_learning_iteration
        return done * self.cfg.ppo.steps_per_iteration

    def resume(self) -> bool:
        """Go on from the state in the directory; False where there is none."""
        path = self.out / RESUME_NAME
        if not path.exists():
            return False
        state = read_plain(path)
        runner = self.runner
        if "identity" not in state:
            raise PolicyError(
                f"{path} is not the state of a training: give another --out, or the "
                "directory that `gaitpref train` wrote"
            )
        changed = differences(json.loads(state["identity"]), self.identity)
        if changed:
            more = f", and {len(changed) - 4} more" if len(changed) > 4 else ""
            raise PolicyError(
                f"{path} was left by a run with other settings "
                f"({', '.join(changed[:4])}{more}), so it cannot go on: give the same "
                "settings, or another --out"
            )
        if not self.ranks.is_first:
            own = state["others"][self.ranks.rank - 1].numpy().tobytes()
            state |= torch.load(io.BytesIO(own), weights_only=True)
        runner.alg.load(state, None, strict=True)
        runner.current_learning_iteration = int(state["iteration"])
        runner.restore(state)
        return True

    def require_same(self) -> None:
        """Go on only if all ranks do the same training from the same place.

        Raises:
            GaitprefError: they do not.
        """
        told = {"identity": self.identity, "steps": self._steps}
        self.ranks.require_same(json.dumps(told, sort_keys=True))

    def run(self, on_iteration: Callable[[IterationStats], None]) -> TrainResult:
        """Train until done or interrupted, saving on the way."""
        cfg, last, ranks = self.cfg, None, self.ranks
        writer = None

        def after(stats: IterationStats) -> bool:
            nonlocal last, writer
            self._require_sound()
            last = stats
            limit, std = cfg.std_limit(stats.iteration), self.runner.std
            if limit is not None and std is not None:
                std.clamp_(max=limit)
            stopping = ranks.any(bool(interrupted))
            if ranks.is_first:
                # Not before: what cannot begin leaves nothing.
                if writer is None:
                    writer = SummaryWriter(str(self.out), flush_secs=10)
                    writer.add_scalar("plan/steps", cfg.steps, stats.steps)
                for tag, value in stats.scalars.items():
                    writer.add_scalar(tag, value, stats.steps)
            if stats.iteration in cfg.checkpoint_iterations:
                name = f"step_{self.steps_before + stats.steps:010d}.pt"
                self._save_policy(self.out / CHECKPOINTS_NAME / name, stats.steps)
            if stats.iteration % cfg.save_every == 0 or stopping:
                self._save_state()
            on_iteration(stats)
            return not stopping

        interrupted: list[int] = []
        try:
            with interrupts(interrupted, ranks):
                self.runner.learn(cfg.iterations, after)
        except (RuntimeError, ValueError):
            # What torch says of ruined weights depends on where it meets them.
            self._require_sound()
            raise
        finally:
            if writer:
                writer.close()
        steps = self._steps
        finished = self.runner.current_learning_iteration >= cfg.iterations
        self._save_state()
        self._save_policy(self.out / POLICY_NAME, steps)
        if last is not None and ranks.is_first:
            summary = {"steps": steps, "finished": finished, **last.scalars}
            write_atomically(
                self.out / SUMMARY_NAME, json.dumps(summary, indent=1).encode()
            )
        # What comes next, on any rank, finds the files of this training.
        ranks.meet()
        return TrainResult(
            finished=finished, steps=steps, policy=self.out / POLICY_NAME, stats=last
        )

    def _identity(self) -> dict[str, Any]:
        """Settings, robot and reward by their contents; the length is left free."""
        settings = to_plain(self.cfg, whole=True)
        for free in ("steps", "checkpoints", "save_every"):
            del settings[free]
        settings["ppo"] = as_written(settings["ppo"])
        told = {
            **settings,
            "robot": self.robot.model_sha256,
            "reward_name": self.reward_name,
            "reward": content_of(self.runner.alg.reward_fn),
            "init": None,
            **self.runner.told,
        }
        # As a file gives it back: a tuple is a list there.
        return json.loads(json.dumps(told))

    def _require_sound(self) -> None:
        """Stop before anything is saved of networks that an update has ruined.

        Raises:
            PolicyError: a weight is no finite number, or the noise is not positive.
        """
        ruined, std = not_finite(self.runner.networks()), self.runner.std
        if not ruined and std is not None and (std <= 0).any():
            ruined = f"exploration noise of {float(std.min()):.3g}"
        if ruined:
            raise PolicyError(
                f"the training in {self.out} diverged at step {self._steps:,} "
                f"({ruined}); what was saved before is kept. Is the reward very large "
                "somewhere? Else try another --seed"
            )

    def _save_state(self) -> None:
        runner, learned = self.runner, self.runner.alg.save()
        own = runner.snapshot()
        state = {
            **learned,
            "identity": json.dumps(self.identity, sort_keys=True),
            "iteration": runner.current_learning_iteration,
            **own,
        }
        if self.ranks.size > 1:
            of_rank = runner.alg.OF_RANK
            own |= {name: learned[name] for name in of_rank if name in learned}
            state["others"] = self.ranks.gathered(saved_bytes(own))[1:]
        if self.ranks.is_first:
            write_atomically(self.out / RESUME_NAME, saved_bytes(state))

    def _save_policy(self, path: Path, steps: int) -> None:
        if not self.ranks.is_first:
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        info = PolicyInfo(
            steps=self.steps_before + steps,
            reward=self.reward_name,
            seed=self.cfg.seed,
            env=self.cfg.env,
            ppo=self.runner.ppo,
            robot_name=self.robot.name,
            robot_mjcf=self.robot.mjcf,
            origin=self.origin,
        )
        save_policy(path, self.runner.policy_states(), info)


@contextmanager
def _own_chance(device: str) -> Iterator[None]:
    """Leave PyTorch's chance outside as it was, on the device too."""
    devices = [] if device == "cpu" else [torch.cuda.current_device()]
    with torch.random.fork_rng(devices=devices):
        yield
