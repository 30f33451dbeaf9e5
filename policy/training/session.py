"""One process's work on the directory of a training: begin, go on, save on the way."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch.utils.tensorboard.writer import SummaryWriter

from data.files.files import sha256_file, write_atomically
from data.files.plain import to_plain
from data.files.weights import not_finite
from policy.law.origin import Origin
from policy.robots.robot import Robot

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
from .ppo import IterationStats
from .train_cfg import TrainCfg
from .training_dir import CHECKPOINTS_NAME, POLICY_NAME, RESUME_NAME, SUMMARY_NAME
from .written import as_written

_OTHER_REPLAY = "what --replay names holds other episodes or steps than it did then"
"""In place of hashes, which say nothing of a data set that grew."""


@dataclass(frozen=True, kw_only=True)
class TrainResult:
    """How a training run ended."""

    finished: bool
    """False where it was interrupted; it can be resumed."""
    steps: int
    policy: Path
    stats: IterationStats | None
    """The last iteration; None where there was nothing to do."""


class Session:
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

    @property
    def _finished(self) -> bool:
        return self.runner.current_learning_iteration >= self.cfg.iterations

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
        changed = [
            _OTHER_REPLAY if each.startswith("replay") else each
            for each in differences(json.loads(state["identity"]), self.identity)
        ]
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
                self._save_summary(stats)
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
        finished = self._finished
        if last is not None:
            self._save_summary(last)
        self._save_state()
        self._save_policy(self.out / POLICY_NAME, steps)
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

    def _save_summary(self, stats: IterationStats) -> None:
        """Before the state: what goes on from one that is finished measures nothing."""
        if not self.ranks.is_first:
            return
        summary = {"steps": self._steps, "finished": self._finished, **stats.scalars}
        write_atomically(
            self.out / SUMMARY_NAME, json.dumps(summary, indent=1).encode()
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
