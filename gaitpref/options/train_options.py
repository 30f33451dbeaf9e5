"""Learning which gait to use when; a run that was killed goes on bit for bit."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import torch

from data.errors import GaitprefError
from data.files.files import write_atomically
from policy.env.course import CourseCfg
from policy.env.env import QuadrupedEnv
from policy.env.seeding import spawned
from policy.options.choice_collect import Collector
from policy.options.choice_learner import Learner, LearnerCfg
from policy.options.choice_row import ChoiceReward
from policy.options.choosing import ChoosingCfg
from policy.parallel.ranks import ALONE
from policy.training.checkpoint import PolicyError, read_plain, saved_bytes
from policy.training.identity import content_of, differences
from policy.training.interrupts import interrupts
from policy.training.training_dir import POLICY_NAME, RESUME_NAME

from .gait_files import Gaits, course_env, options_bytes

_SAVE_LOOKS = 40
"""Looks of all environments between two states that a run goes on from."""


@dataclass(frozen=True, kw_only=True)
class OptionsCfg:
    """One training of a chooser."""

    course: CourseCfg = field(default_factory=CourseCfg)
    choosing: ChoosingCfg = field(default_factory=ChoosingCfg)
    learner: LearnerCfg = field(default_factory=LearnerCfg)
    speed_m_s: float = 0.6
    """Forward speed that is asked for on the whole course."""
    episode_s: float = 14.0
    """Time after which an episode is cut."""
    envs: int = 64
    """Robots side by side."""
    steps: int = 200_000
    """Environment steps in all."""
    seed: int = 0


@dataclass(frozen=True, kw_only=True)
class LookStats:
    """What the last looks of a training came to."""

    steps: int
    falls: int
    speed_m_s: float
    """Along the course, mean."""
    changes_per_s: float
    error: float
    """Of the values, return."""


class OptionsTraining:
    """Everything that learns, and that is saved."""

    def __init__(self, gaits: Gaits, cfg: OptionsCfg, reward: ChoiceReward) -> None:
        cost = reward.change_cost(gaits.env.control_dt_s)
        self.cfg = cfg = replace(cfg, choosing=replace(cfg.choosing, change_cost=cost))
        self.gaits, self.reward = gaits, reward
        self.env_cfg = course_env(
            gaits, cfg.course, speed_m_s=cfg.speed_m_s, episode_s=cfg.episode_s
        )
        env_seed, model_seed, learner_seed, chance_seed = spawned(cfg.seed, 4)
        self.model = gaits.model(cfg.choosing, seed=model_seed)
        self.model.rng = torch.Generator().manual_seed(chance_seed)
        practice = replace(self.env_cfg, course=replace(cfg.course, anywhere=True))
        self.env = QuadrupedEnv(
            gaits.robot, practice, cfg.envs, seed=env_seed, keep_final=True
        )
        self.learner = Learner(
            self.model.chooser,
            cfg.choosing,
            cfg.learner,
            torch.Generator().manual_seed(learner_seed),
        )
        self.collector = Collector(
            self.env, self.model, reward, gamma=cfg.learner.gamma
        )
        self.steps = 0

    @property
    def done(self) -> bool:
        """Whether all steps were made."""
        return self.steps >= self.cfg.steps

    def look(self) -> LookStats:
        """From one look ahead to the next, and what is learned from it."""
        dt_s = self.env.step_dt
        control_steps = self.cfg.choosing.look_steps(dt_s)
        share = self.steps / max(1, self.cfg.steps)
        self.model.explored = self.cfg.learner.explored_at(share)
        found = self.collector.collect(control_steps)
        self.steps += control_steps * self.cfg.envs
        self.learner.take(found.transitions)
        robot_s = control_steps * self.cfg.envs * dt_s
        return LookStats(
            steps=self.steps,
            falls=found.falls,
            speed_m_s=found.moved_m / robot_s,
            changes_per_s=found.changes / robot_s,
            error=self.learner.learn(),
        )

    @property
    def identity(self) -> dict[str, Any]:
        """What a run that goes on must have in common with the one that began."""
        told = content_of(
            {
                "options": replace(self.cfg, steps=0),
                "gaits": [
                    [name, policy.sha256]
                    for name, policy in zip(
                        self.gaits.names, self.gaits.policies, strict=True
                    )
                ],
                "reward": self.reward,
            }
        )
        return json.loads(json.dumps(told))

    def policy(self) -> bytes:
        """The contents of its policy file."""
        return options_bytes(
            self.gaits,
            self.model,
            self.env_cfg,
            steps=self.steps,
            reward=self.reward.told,
            seed=self.cfg.seed,
        )

    def save(self, path: Path) -> None:
        """Write all that it goes on from."""
        assert self.model.rng is not None
        state = {
            "actor_state_dict": dict(self.model.state_dict()),
            "identity": json.dumps(self.identity),
            "steps": self.steps,
            "env": self.env.snapshot(),
            "learner": self.learner.snapshot(),
            "collector": self.collector.snapshot(),
            "chance": self.model.rng.get_state(),
        }
        write_atomically(path, saved_bytes(state))

    def resume(self, path: Path) -> None:
        """Go on from what was saved.

        Raises:
            PolicyError: it is of another training, or damaged.
        """
        state = read_plain(path)
        if "identity" not in state or "learner" not in state:
            raise PolicyError(
                f"{path} is not the state of a choice among gaits: give another --out"
            )
        changed = differences(json.loads(state["identity"]), self.identity)
        if changed:
            raise PolicyError(
                f"{path} was left by a run with other settings "
                f"({', '.join(changed[:4])}), so it cannot go on: give the same "
                "settings, or another --out"
            )
        assert self.model.rng is not None
        self.steps = int(state["steps"])
        self.env.restore(state["env"])
        self.learner.restore(state["learner"])
        self.collector.restore(state["collector"])
        self.model.rng.set_state(state["chance"])


def train_options(
    out: Path,
    gaits: Gaits,
    cfg: OptionsCfg,
    reward: ChoiceReward,
    *,
    tell: Callable[[LookStats], None] = lambda stats: None,
    most_looks: int | None = None,
) -> bool:
    """Learn, or go on with, the chooser in `out`; False where it was interrupted.

    Args:
        out: Gets the policy, and what a training goes on from.
        gaits: What is chosen among.
        cfg: How, and where.
        reward: What is paid.
        tell: Called after every look.
        most_looks: Stop after so many, to go on later.

    Raises:
        GaitprefError: what lies in `out` is of another training.
    """
    out.mkdir(parents=True, exist_ok=True)
    policy, resume = out / POLICY_NAME, out / RESUME_NAME
    training = OptionsTraining(gaits, cfg, reward)
    if resume.exists():
        training.resume(resume)
    elif policy.exists():
        raise GaitprefError(f"{out} holds another policy: give another --out")
    received: list[int] = []
    looks = 0
    with interrupts(received, ALONE):
        while not (training.done or received or looks == most_looks):
            tell(training.look())
            looks += 1
            if looks % _SAVE_LOOKS == 0:
                training.save(resume)
    out.mkdir(parents=True, exist_ok=True)
    training.save(resume)
    if not training.done:
        return False
    write_atomically(policy, training.policy())
    return True
